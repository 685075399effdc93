// SPDX-License-Identifier: Apache-2.0
// Scores, frame times and measurements of a finished run.
#include "eval/runs/evaluate_run.h"

#include <gtest/gtest.h>

#include "eval/runs/bench_subject.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

nlohmann::json results(const std::filesystem::path& folder) { return parse_json(read_input(folder / "results.json")); }

TEST(EvaluateRun, WritesScoresAndFrameTimes) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    EvalOptions options;
    options.run_folder = saved.path();
    options.iteration = run.iteration;
    const EvalResult result = evaluate_run(run, options, 1, saved.path());
    const auto json = results(saved.path());
    EXPECT_EQ(json["ours_100"]["PSNR"], result.psnr);
    EXPECT_GT(json["timing"]["ours_100"]["frame_seconds"].get<double>(), 0);
    EXPECT_EQ(json["num_gaussians"]["ours_100"], 1);
}

TEST(EvaluateRun, ResultsOfAnotherSceneLieApart) {
    EXPECT_EQ(results_folder("run", ""), "run");
    EXPECT_EQ(results_folder("run", "builtin:glossy"), "run/on-glossy");
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

}  // namespace
}  // namespace gs
