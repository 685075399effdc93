// SPDX-License-Identifier: Apache-2.0
// What is written during and after a training.
#include "eval/runs/training_evaluation.h"

#include <gtest/gtest.h>

#include <sstream>

#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"

namespace gs {
namespace {

class TimedEngine : public test::FakeEngine {
  public:
    std::optional<double> time_frames(const std::vector<RenderRequest>&, int repeats) override {
        return 0.01 * repeats;
    }
};

class TrainingEvaluationTest : public ::testing::Test {
  protected:
    TrainingEvaluationTest() {
        options_.source = "builtin:diffuse";
        options_.iterations = 20;
        options_.model = tmp_.path().string();
        View view;
        view.name = "a.png";
        view.camera.width = 16, view.camera.height = 12;
        view.load = [] {
            return ViewImage{Image{16, 12, 3, std::vector<std::uint8_t>(16 * 12 * 3, 51), {}}, std::nullopt};
        };
        scene_.test.push_back(view);
    }
    nlohmann::json results() const { return parse_json(read_input(tmp_.path() / "results.json")); }
    test::TemporaryFolder tmp_;
    TrainOptions options_;
    Scene scene_;
    std::ostringstream bar_, lines_;
    Progress progress_{ProgressStyle::kJsonLines, bar_, lines_, 0};
    test::BackendOf<TimedEngine> backend_;
};

TEST_F(TrainingEvaluationTest, KeepsOnlyScoresOfIntermediateIterations) {
    TrainingEvaluation evaluation(options_, scene_, progress_, 3);
    const auto scores = evaluation(10, backend_, false);
    ASSERT_TRUE(scores);
    EXPECT_EQ(scores->views, scene_.test.size());
    EXPECT_EQ(results()["ours_10"]["PSNR"], scores->psnr);
    EXPECT_EQ(results()["ours_10"]["SSIM"], scores->ssim);
    EXPECT_EQ(evaluation.iteration(), 10);
    EXPECT_TRUE(results()["ours_10"].contains("PSNR"));
    EXPECT_FALSE(results()["timing"]["ours_10"].contains("frame_seconds"));
    EXPECT_FALSE(std::filesystem::exists(tmp_.path() / "comparison.png"));
    EXPECT_FALSE(std::filesystem::exists(tmp_.path() / "test"));
    EXPECT_NE(lines_.str().find("\"event\":\"evaluation\",\"iteration\":10"), std::string::npos) << lines_.str();
}

TEST_F(TrainingEvaluationTest, AddsPicturesAndTimesOfTheTrainedModel) {
    TrainingEvaluation evaluation(options_, scene_, progress_, 3);
    evaluation(20, backend_, true);
    evaluation.finish(
        {.iterations = 20, .num_gaussians = 7, .train_seconds = 4, .memory = {}, .photometric = "on: made up"});
    EXPECT_TRUE(std::filesystem::exists(tmp_.path() / "comparison.png"));
    EXPECT_TRUE(std::filesystem::exists(tmp_.path() / "test" / "ours_20" / "renders" / "00000.png"));
    const auto json = results();
    EXPECT_EQ(json["timing"]["ours_20"]["train_seconds"], 4);
    EXPECT_TRUE(json["timing"]["ours_20"].contains("frame_seconds"));
    EXPECT_EQ(json["photometric"]["ours_20"]["decision"], "on: made up");
    EXPECT_EQ(json["num_gaussians"]["ours_20"], 7);
}

TEST_F(TrainingEvaluationTest, TheTimeOfAPartIsNotThatOfTheRun) {
    TrainingEvaluation evaluation(options_, scene_, progress_, 0);
    evaluation(20, backend_, true);
    evaluation.finish({.iterations = 20,
                       .num_gaussians = 7,
                       .train_seconds = 4,
                       .memory = {},
                       .photometric = "",
                       .whole_time = false});
    EXPECT_FALSE(results()["timing"]["ours_20"].contains("train_seconds"));
}

}  // namespace
}  // namespace gs
