// SPDX-License-Identifier: Apache-2.0
// The evaluation loop, its pictures, the JSON files and the tables made from them.
#include "eval/runs/evaluate.h"

#include <gtest/gtest.h>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "eval/runs/bench_subject.h"
#include "eval/runs/evaluate_run.h"
#include "eval/runs/protocol.h"
#include "eval/runs/results.h"
#include "eval/runs/training_evaluation.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/support/fake_engine.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

using nlohmann::json;
using FakeBackend = test::BackendOf<test::FakeEngine>;
using test::TemporaryFolder;

/// A view of one colour; the fake backend will paint (red, background, 0).
View view(const std::string& name, float red, std::vector<std::uint8_t> pixel, int width = 16, int height = 12) {
    View v;
    v.name = name;
    v.camera.width = width, v.camera.height = height;
    v.camera.translation.x() = red;
    v.load = [pixel, width, height] {
        ViewImage image;
        image.color = {width, height, int(pixel.size()), {}, {}};
        for (int i = 0; i < width * height; ++i)
            image.color.u8.insert(image.color.u8.end(), pixel.begin(), pixel.end());
        return image;
    };
    return v;
}

json read_json(const std::filesystem::path& path) { return parse_json(read_input(path)); }

std::vector<View> two_views() { return {view("a.png", 1.0f, {255, 0, 51}), view("b.png", 0.4f, {0, 0, 0})}; }

TEST(Evaluate, ScoresAreMeansOverViewsOfTheRoundedImages) {
    FakeBackend backend;
    const RunResult result = evaluate_views(backend, two_views(), {0, 0, 0}, {});
    ASSERT_EQ(result.views.size(), 2u);
    EXPECT_NEAR(result.views[0].psnr, 10 * std::log10(3 / (0.2 * 0.2)), 1e-5);
    EXPECT_NEAR(result.views[1].psnr, 10 * std::log10(3 / (0.4 * 0.4)), 1e-5);
    EXPECT_NEAR(result.psnr, 0.5 * (result.views[0].psnr + result.views[1].psnr), 1e-12);
    EXPECT_NEAR(result.views[1].ssim, (2 + 1e-4 / (0.16 + 1e-4)) / 3, 1e-6);
    EXPECT_EQ(result.views[1].name, "b.png");
    EXPECT_GE(result.render_seconds, 0);
    EXPECT_THROW(evaluate_views(backend, {}, {0, 0, 0}, {}), UsageError);
}

TEST(Evaluate, AlphaIsCompositedOnTheSameBackground) {
    FakeBackend backend;
    // Transparent target on (0, 1, 0) against the fake's (0, 1, 0).
    const RunResult result = evaluate_views(backend, {view("a", 0, {9, 9, 9, 0})}, {0, 1, 0}, {});
    EXPECT_TRUE(std::isinf(result.psnr));
}

TEST(Evaluate, SizeMismatchIsADataError) {
    FakeBackend backend;
    View v = view("odd.png", 0, {0, 0, 0});
    v.camera.width = 20;
    try {
        evaluate_views(backend, {v}, {0, 0, 0}, {});
        FAIL();
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("odd.png: the image has 16x12 pixels, its camera 20x12"),
                  std::string::npos);
    }
}

TEST(Evaluate, WritesPicturesWhereOtherToolsLookForThem) {
    const TemporaryFolder folder;
    FakeBackend backend;
    EvalOptions options;
    options.run_folder = folder.path();
    options.iteration = 300;
    evaluate_views(backend, two_views(), {0, 0, 0}, options);
    const Image render = read_image(folder.path() / "test/ours_300/renders/00001.png"),
                truth = read_image(folder.path() / "test/ours_300/gt/00000.png");
    EXPECT_EQ(render.u8[0], 102);
    EXPECT_EQ(truth.u8[2], 51);
}

TEST(Evaluate, DecompositionHasTheBaseOnTheBackgroundAndTheResidualOnBlack) {
    const TemporaryFolder folder;
    FakeBackend backend;
    EvalOptions options;
    EXPECT_FALSE(evaluate_views(backend, two_views(), {0, 1, 0}, options).residual_mean);
    options.decompose = true;
    const RunResult result = evaluate_views(backend, two_views(), {0, 1, 0}, options);
    EXPECT_NEAR(*result.views[0].residual_mean, (1 + 0 + 0.5) / 3, 1e-6);
    EXPECT_NEAR(*result.views[1].residual_mean, (0.4 + 0 + 0.5) / 3, 1e-6);
    EXPECT_NEAR(*result.residual_mean, (0.5 + 0.3) / 2, 1e-6);
    options.run_folder = folder.path();
    options.iteration = 300;
    evaluate_views(backend, two_views(), {0, 1, 0}, options);
    const Image base = read_image(folder.path() / "test/ours_300/base/00001.png"),
                residual = read_image(folder.path() / "test/ours_300/residual/00001.png");
    EXPECT_EQ(std::vector(base.u8.begin(), base.u8.begin() + 3), (std::vector<std::uint8_t>{102, 255, 51}));
    EXPECT_EQ(std::vector(residual.u8.begin(), residual.u8.begin() + 3), (std::vector<std::uint8_t>{102, 0, 128}));
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "test/ours_300/renders/00001.png"));
}

TEST(Evaluate, ComparisonShowsPhotographLeftAndRenderRight) {
    const TemporaryFolder folder;
    FakeBackend backend;
    write_comparison(folder.path() / "c.png", backend, two_views(), {0, 0, 0}, 5);
    const Image sheet = read_image(folder.path() / "c.png");
    ASSERT_EQ(sheet.width, 32);
    ASSERT_EQ(sheet.height, 24);
    EXPECT_FLOAT_EQ(sheet.value(3, 3, 2), 0.2f);
    EXPECT_FLOAT_EQ(sheet.value(20, 3, 2), 0);
    EXPECT_FLOAT_EQ(sheet.value(3, 20, 0), 0);
    EXPECT_FLOAT_EQ(sheet.value(20, 20, 0), 0.4f);
    write_comparison(folder.path() / "one.png", backend, two_views(), {0, 0, 0}, 1);
    EXPECT_EQ(read_image(folder.path() / "one.png").height, 12);
}

struct Written {
    TemporaryFolder folder;
    RunResult result;
    Written() {
        result.iteration = 300;
        result.dataset = "builtin";
        result.bytes_per_gaussian = 192;
        result.scene = "builtin:glossy";
        result.model = "sh (degree 3)";
        result.strategy = "mcmc";
        result.num_gaussians = 1234;
        result.train_seconds = 61.5;
        result.peak_device_bytes = 1234567890;
        result.views = {{"a.png", 30, 0.9, 0.1}, {"b.png", 32, 0.8, 0.2}};
        result.psnr = 31, result.ssim = 0.85, result.render_seconds = 0.3;
        result.protocol = protocol_json({}, {0, 0, 0}, result.views.size());
    }
    void write() { write_results(RunFolder{folder.path()}, result); }
};

TEST(Results, KeysAreThoseOfTheMetricsScript) {
    Written w;
    w.write();
    const json results = read_json(w.folder.path() / "results.json"),
               per_view = read_json(w.folder.path() / "per_view.json");
    EXPECT_EQ(results.at("ours_300"), (json{{"SSIM", 0.85}, {"PSNR", 31.0}})) << "nothing else may stand inside";
    EXPECT_EQ(per_view.at("ours_300"), (json{{"SSIM", {{"00000.png", 0.9}, {"00001.png", 0.8}}},
                                             {"PSNR", {{"00000.png", 30.0}, {"00001.png", 32.0}}}}));
    EXPECT_EQ(per_view["image_names"]["ours_300"]["00001.png"], "b.png");
    EXPECT_EQ(results["num_gaussians"]["ours_300"], 1234);
    EXPECT_EQ(results["timing"]["ours_300"]["train_seconds"], 61.5);
    EXPECT_EQ(results["memory"]["ours_300"]["peak_device_bytes"], 1234567890);
    EXPECT_NE(results["protocol"]["ours_300"]["ssim"].get<std::string>().find("torchmetrics <= 1.4.1"),
              std::string::npos);
}

TEST(Results, OtherIterationsAndTheTrainingTimeStay) {
    Written w;
    w.write();
    w.result.iteration = 700;
    w.result.psnr = std::numeric_limits<double>::infinity();
    w.write();
    w.result.iteration = 300;
    w.result.psnr = 20;
    w.result.train_seconds.reset();
    w.result.peak_device_bytes.reset();
    w.write();
    const json results = read_json(w.folder.path() / "results.json");
    EXPECT_EQ(results["ours_300"]["PSNR"], 20.0);
    EXPECT_EQ(results["timing"]["ours_300"]["train_seconds"], 61.5);
    EXPECT_EQ(results["memory"]["ours_300"]["peak_device_bytes"], 1234567890);
    EXPECT_TRUE(results["ours_700"]["PSNR"].is_null()) << "JSON has no infinity";
    EXPECT_EQ(read_json(w.folder.path() / "per_view.json").count("ours_700"), 1u);
}

TEST(Results, DecompositionStandsBesideTheScores) {
    Written w;
    w.write();
    EXPECT_FALSE(read_json(w.folder.path() / "results.json").contains("decomposition"));
    w.result.residual_mean = 0.25;
    w.result.views[0].residual_mean = 0.2, w.result.views[1].residual_mean = 0.3;
    w.write();
    const json results = read_json(w.folder.path() / "results.json"),
               per_view = read_json(w.folder.path() / "per_view.json");
    EXPECT_EQ(results["ours_300"], (json{{"SSIM", 0.85}, {"PSNR", 31.0}}));
    EXPECT_EQ(results["decomposition"]["ours_300"], (json{{"residual_mean", 0.25}}));
    EXPECT_EQ(per_view["decomposition"]["ours_300"]["residual_mean"], (json{{"00000.png", 0.2}, {"00001.png", 0.3}}));
}

TEST(Results, ABrokenFileIsNamedAndKept) {
    Written w;
    const auto path = w.folder.write("results.json", "{\"ours_1\": ");
    try {
        w.write();
        FAIL();
    } catch (const DataError& e) {
        EXPECT_NE(std::string(e.what()).find("results.json"), std::string::npos);
    }
    std::ifstream file(path);
    std::string text;
    std::getline(file, text);
    EXPECT_EQ(text, "{\"ours_1\": ");
}

TEST(Results, EveryFieldIsReadAsItWasWritten) {
    Written w;
    RunResult& r = w.result;
    r.controller_seconds = 2.5, r.frame_seconds = 0.5, r.residual_mean = 0.25, r.residual_share = 0.5;
    r.aligned_psnr = 32.5, r.aligned_ssim = 0.875, r.aligned_pixels = 0.125;
    r.ply_bytes_per_gaussian = 248, r.web_bytes_per_gaussian = 56, r.photometric = "on: made up",
    r.refine_cameras = "off: made up";
    r.frame = {{"scale", 2}}, r.plan = {{"size", {{"bytes", 7}}}}, r.appearance_choice = {{"model", "sh"}};
    r.frame_times = FrameTimes{"d", 3, 9, 2, 1.5, 1, 4};
    w.write();
    const RunResult read = read_results(w.folder.path(), 300);
    std::set<std::string> names;
    for (const ResultField& field : result_fields()) {
        EXPECT_TRUE(names.insert(field.name).second) << field.name << " is there twice";
        if (!field.section) continue;
        EXPECT_TRUE(field_json(r, field)) << field.name << " is not tested";
        EXPECT_EQ(field_json(read, field), field_json(r, field)) << field.name;
    }
}

TEST(Results, AreReadFromStoredFilesAlone) {
    Written w;
    w.write();
    w.result.iteration = 1000;
    w.result.psnr = 33;
    w.write();
    const RunResult last = read_results(w.folder.path(), std::nullopt);
    EXPECT_EQ(last.iteration, 1000) << "by number, not by text";
    EXPECT_EQ(last.psnr, 33);
    const RunResult result = read_results(w.folder.path().string() + "/", 300);
    EXPECT_EQ(result.psnr, 31);
    EXPECT_EQ(result.run, w.folder.path().filename());
    EXPECT_EQ(result.scene, "builtin:glossy");
    EXPECT_EQ(*result.num_gaussians, 1234);
    EXPECT_EQ(*result.train_seconds, 61.5);
    EXPECT_EQ(*result.peak_device_bytes, 1234567890);
    EXPECT_EQ(result.dataset, "builtin");
    EXPECT_EQ(*result.bytes_per_gaussian, 192);
    EXPECT_EQ(result.protocol_name(), "paper");
    EXPECT_EQ(result.protocol_line(), protocol_line(EvalOptions{}.protocol, {0, 0, 0}));
    EXPECT_THROW(read_results(w.folder.path(), 5), DataError);
    EXPECT_THROW(read_results(w.folder.path() / "nowhere", std::nullopt), DataError);
}

TEST(Results, ReadsFilesOfOtherProgramsAndNamesMistakes) {
    const TemporaryFolder folder;
    folder.write(
        "results.json",
        R"({"ours_7": {"SSIM": 0.5, "PSNR": 20.25, "LPIPS": 0.1, "note": "x"}, "not_measured": {"ours_7": {"DISTS": "why"}}})");
    const RunResult result = read_results(folder.path(), std::nullopt);
    EXPECT_EQ(result.psnr, 20.25);
    EXPECT_EQ(result.scores.at("LPIPS").value, 0.1);
    EXPECT_EQ(result.scores.at("DISTS").reason, "why");
    EXPECT_FALSE(result.num_gaussians);
    EXPECT_EQ(result.protocol_line(), "");
    for (const char* bad :
         {R"({"ours_7": {"SSIM": 0.5}})", R"({"ours_7": {"SSIM": 0.5, "PSNR": "x"}})", R"({"other": 1})", "[]", "{",
          R"({"ours_7": 3})", R"({"ours_7": {"SSIM": 0.5, "PSNR": 20}, "protocol": {"ours_7": {"name": "later"}}})"}) {
        folder.write("results.json", bad);
        EXPECT_THROW(read_results(folder.path(), std::nullopt), DataError) << bad;
    }
}

TEST(Results, FrameTimesAreReadWhereTheyAreWhole) {
    const TemporaryFolder folder;
    const auto read = [&](const std::string& times) {
        folder.write("results.json",
                     R"({"ours_7": {"SSIM": 0.5, "PSNR": 20}, "frame_times": {"ours_7": )" + times + "}}");
        return read_results(folder.path(), std::nullopt).frame_times;
    };
    const auto times = read(
        R"({"device": "d", "num_views": 3, "frames_per_view": 9, "mean_seconds": 2, "median_seconds": 1.5, "min_seconds": 1, "max_seconds": 4})");
    ASSERT_TRUE(times);
    EXPECT_EQ(times->device, "d");
    EXPECT_EQ(times->frames_per_view, 9);
    EXPECT_EQ(times->median, 1.5);
    EXPECT_FALSE(read(R"({"device": "d", "num_views": 3, "frames_per_view": 9, "mean_seconds": 2})"));
    EXPECT_FALSE(read("7"));
}

// Scores, frame times and measurements of a finished run.

nlohmann::json results(const std::filesystem::path& folder) { return parse_json(read_input(folder / "results.json")); }

TEST(EvaluateRun, WritesScoresAndFrameTimes) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    EvalOptions options;
    options.run_folder = saved.path();
    options.iteration = run.iteration;
    const RunResult result = evaluate_run(run, options, 1, saved.path());
    const auto json = results(saved.path());
    EXPECT_EQ(json["ours_100"]["PSNR"], result.psnr);
    EXPECT_GT(json["timing"]["ours_100"]["frame_seconds"].get<double>(), 0);
    EXPECT_EQ(json["num_gaussians"]["ours_100"], 1);
}

TEST(EvaluateRun, ResultsOfAnotherSceneLieApart) {
    EXPECT_EQ(results_folder("run", {}), "run");
    EXPECT_EQ(results_folder("run", {.source = "builtin:glossy"}), "run/on-glossy");
    EXPECT_EQ(results_folder("run", {.lens = LensMode::kNative}), "run/on-native");
}

TEST(RunFrameTimes, AreAddedToTheResults) {
    const test::TinyRun saved;
    const FrameTimesLine line = time_run_frames(saved.path(), std::nullopt, {.device = Device::kCpu}, 1);
    EXPECT_EQ(line.run, saved.path());
    EXPECT_EQ(line.scene, "diffuse");
    EXPECT_EQ(line.num_gaussians, 1);
    EXPECT_EQ(line.times.num_views, 8) << "the test views";
    EXPECT_EQ(results(saved.path())["frame_times"]["ours_100"]["mean_seconds"], line.times.mean);
    EXPECT_THROW(time_run_frames(saved.path(), 7, {.device = Device::kCpu}, 1), DataError);
}

TEST(BenchSubject, IsTheTrainedModelWhereThereIsOne) {
    const test::TinyRun saved(test::one_sh_gaussian(0.1f));
    const BenchSubject subject = bench_subject(saved.options, std::nullopt);
    EXPECT_EQ(subject.name, "builtin:diffuse, " + saved.options.model + " at iteration 100");
    EXPECT_EQ(subject.model.count, 1);
    EXPECT_EQ(subject.model.active_degree, 1) << "all degrees";
    EXPECT_FALSE(subject.scene.train.empty());
    EXPECT_THROW(bench_subject(saved.options, 7), DataError);
}

TEST(BenchSubject, IsTheInitialPointsElsewhere) {
    const test::TinyRun saved;
    TrainOptions options = saved.options;
    options.model.clear();
    const BenchSubject subject = bench_subject(options, std::nullopt);
    EXPECT_EQ(subject.name, "builtin:diffuse, initial points");
    EXPECT_GT(subject.model.count, 1);
    EXPECT_THROW(bench_subject(options, 100), UsageError) << "there is no model whose iteration could be meant";
}

// What is written during and after a training.

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
