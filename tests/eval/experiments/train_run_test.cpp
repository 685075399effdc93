// SPDX-License-Identifier: Apache-2.0
// Two iterations of a small scene, with and without evaluation.
#include "apps/gsapp/train/train_run.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions tiny(const test::TemporaryFolder& tmp) {
    TrainOptions options;
    options.source = "builtin:diffuse";
    options.resolution = 8;
    options.device = Device::kCpu;
    options.appearance = "none";
    options.iterations = 2;
    options.quiet = true;
    options.model = (tmp.path() / "run").string();
    return options;
}

TEST(TrainRun, ScoresWhatWasHeldOut) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.eval = true;
    validate(options);
    const std::optional<TableRow> row = train_run(options, 1);
    ASSERT_TRUE(row);
    EXPECT_EQ(row->iteration, 2);
    EXPECT_GT(row->psnr, 0);
    EXPECT_TRUE(row->train_seconds);
    EXPECT_TRUE(row->frame_seconds);
    EXPECT_FALSE(row->training.empty()) << "the options are those of the run";
    for (const char* file :
         {"config.yaml", "results.json", "comparison.png", "gsapp.log", "point_cloud/iteration_2/point_cloud.ply"})
        EXPECT_TRUE(std::filesystem::exists(std::filesystem::path(options.model) / file)) << file;
}

TEST(TrainRun, HasNoRowWithoutEvaluation) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    validate(options);
    EXPECT_FALSE(train_run(options, 0));
    EXPECT_FALSE(std::filesystem::exists(std::filesystem::path(options.model) / "results.json"));
}

TEST(TrainRun, TargetsAreMeasuredOnViewsThatAreNotTrainedOn) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.eval = true, options.target_psnr = 5;
    options.iterations = 40, options.init_points = 200, options.cap_max = 300;
    validate(options);
    ASSERT_TRUE(train_run(options, 0));
    std::ifstream file(std::filesystem::path(options.model) / "results.json");
    const auto results = nlohmann::json::parse(file);
    const auto& plan = results.at("plan").begin().value();
    const auto& target = plan.at("target");
    EXPECT_EQ(target.at("psnr"), 5);
    EXPECT_GT(target.at("held_out_views"), 0);
    EXPECT_TRUE(target.at("reached")) << target.dump();
    EXPECT_GE(target.at("held_out_psnr"), 5);
    EXPECT_GE(target.at("standard_error"), 0);
    EXPECT_EQ(plan.at("recipe"), "frontier");
}

TEST(TrainRun, ARunIsResumedWithATargetOnlyIfItBeganWithOne) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    validate(options);
    train_run(options, 0);
    const auto config = [&] {
        std::ifstream file(RunFolder{options.model}.config());
        return std::string(std::istreambuf_iterator<char>(file), {});
    };
    const std::string before = config();
    options.resume = "latest", options.iterations = 4, options.target_psnr = 5;
    validate(options);
    EXPECT_THROW(train_run(options, 0), UsageError);
    EXPECT_EQ(config(), before) << "the run can go on without it";
}

TEST(TrainRun, ACheckpointWhoseOptionsAreBrokenIsRefused) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    validate(options);
    train_run(options, 0);
    const auto file = RunFolder{options.model}.checkpoint(2);
    const Checkpoint whole = read_checkpoint(file);
    options.resume = file.string(), options.iterations = 4;
    for (const char* text : {"target-psnr: [", "target-psnr: high"}) {
        Checkpoint broken = whole;
        broken.options_yaml = text;
        write_checkpoint(file, broken);
        EXPECT_THROW(train_run(options, 0), DataError) << text;
    }
}

TEST(TrainRun, ATargetNeedsEnoughViews) {
    const test::TemporaryFolder tmp;
    TrainOptions options = tiny(tmp);
    options.target_psnr = 5;
    validate(options);
    Scene scene;
    EXPECT_THROW(TargetViews(options, scene), UsageError) << "no view";
}

}  // namespace
}  // namespace gs
