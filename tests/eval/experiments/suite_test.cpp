// SPDX-License-Identifier: Apache-2.0
// The grids of the suites, which run folders count as finished, runs with several seeds, and what a suite writes.
#include <gtest/gtest.h>
#include <cmath>
#include <fstream>

#include "apps/gsapp/train/seeds.h"
#include "apps/gsapp/train/train_run.h"
#include "eval/experiments/suite.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

TrainOptions base_options() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = "out";
    o.cap_max = 5005;
    o.iterations = 20;
    return o;
}

TEST(Suite, DensificationVariesTheStrategyAndItsBudget) {
    const auto lines = suite_lines("densification", {"sh", "neural"}, base_options());
    ASSERT_EQ(lines.size(), 8u);
    const auto& mcmc = lines[0].job.options;
    EXPECT_EQ(lines[0].row, "MCMC");
    EXPECT_EQ(lines[0].job.name, "MCMC, sh");
    EXPECT_EQ(mcmc.model, "out/mcmc-sh");
    EXPECT_TRUE(mcmc.eval);
    EXPECT_EQ(mcmc.cap_max, 5005);
    EXPECT_EQ(mcmc.opacity_lr, 0.05);
    EXPECT_EQ(lines[1].job.options.cap_max, 501) << "a tenth, rounded";
    EXPECT_EQ(lines[1].job.options.strategy, Strategy::kMcmc);
    EXPECT_EQ(lines[2].job.options.strategy, Strategy::kAdc);
    EXPECT_EQ(lines[2].job.options.opacity_lr, 0.025) << "decided by the job's own strategy";
    EXPECT_FALSE(lines[2].job.options.speedy_splat);
    EXPECT_TRUE(lines[3].job.options.speedy_splat);
    EXPECT_EQ(lines[3].job.options.opacity_lr, 0.05);
    EXPECT_EQ(lines[7].appearance, "neural");
    EXPECT_EQ(lines[7].job.options.appearance, "neural");
    EXPECT_EQ(lines[7].job.options.model, "out/adc-speedy-neural");
    EXPECT_EQ(lines[7].job.options.iterations, 20) << "what the suite does not vary is the caller's";
}

TEST(Suite, ActivationsVaryTheFunctionAndTheOpacityRate) {
    const auto lines = suite_lines("activations", {"sh"}, base_options());
    ASSERT_EQ(lines.size(), 12u);
    EXPECT_EQ(lines[4].row, "softplus, opacity rate 0.025");
    EXPECT_EQ(lines[4].job.options.color_activation, ColorActivation::kSoftplus);
    EXPECT_EQ(lines[4].job.options.opacity_lr, 0.025);
    EXPECT_FALSE(lines[11].job.options.opacity_lr) << "auto";
    EXPECT_EQ(lines[11].job.options.model, "out/hardsigmoid-auto-sh");
}

TEST(Suite, MistakesAreUsageErrors) {
    EXPECT_THROW(suite_lines("everything", {"sh"}, base_options()), UsageError);
    EXPECT_THROW(suite_lines("activations", {"sj"}, base_options()), UsageError);
    EXPECT_THROW(suite_lines("activations", {"sh", "auto"}, base_options()), UsageError);
    TrainOptions nowhere = base_options();
    nowhere.source.clear();
    EXPECT_THROW(suite_lines("activations", {"sh"}, nowhere), UsageError);
}

class SuiteJobs : public ::testing::Test {
  protected:
    SuiteJobs() {
        TrainOptions base = base_options();
        base.model = tmp_.path().string();
        line_ = suite_lines("densification", {"sh"}, base)[0];
        write("config.yaml", options_to_yaml(line_.job.options));
        write("point_cloud/iteration_20/point_cloud.ply", "0123456789");
        write("results.json", R"({"ours_20": {"PSNR": 20.5, "SSIM": 0.75}, "num_gaussians": {"ours_20": 123},
                                 "timing": {"ours_20": {"train_seconds": 4, "frame_seconds": 0.5}}})");
    }
    void write(const std::string& name, const std::string& text) {
        const auto file = std::filesystem::path(line_.job.options.model) / name;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file) << text;
    }
    test::TemporaryFolder tmp_;
    SuiteLine line_;
};

TEST_F(SuiteJobs, AFinishedRunOfTheSameOptionsIsTaken) {
    line_.job.options.quiet = true;  // changes no figure
    const auto result = finished_job(line_.job.options);
    ASSERT_TRUE(result);
    EXPECT_EQ(result->psnr, 20.5);
    EXPECT_EQ(result->ssim, 0.75);
    EXPECT_EQ(result->num_gaussians, 123);
    EXPECT_EQ(result->train_seconds, 4);
    EXPECT_EQ(result->frame_seconds, 0.5);
    EXPECT_EQ(result->bytes, 10);
}

TEST_F(SuiteJobs, AnotherRunOrABrokenOneIsNot) {
    Job other = line_.job;
    other.options.seed = 7;
    EXPECT_FALSE(finished_job(other.options));
    EXPECT_FALSE(holds_same_run(other.options));
    other = line_.job;
    other.options.source = "builtin:glossy";
    EXPECT_FALSE(finished_job(other.options));
    write("results.json", R"({"ours_20": {"PSNR": 20.5, "SSIM": 0.75}, "num_gaussians": {"ours_20": 123}})");
    EXPECT_FALSE(finished_job(line_.job.options)) << "the times come last";
    EXPECT_TRUE(holds_same_run(line_.job.options));
    write("results.json", "{");
    EXPECT_FALSE(finished_job(line_.job.options));
    write("config.yaml", "what: ever\n");
    EXPECT_FALSE(holds_same_run(line_.job.options));
    other.options.model = (tmp_.path() / "nothing").string();
    EXPECT_FALSE(holds_same_run(other.options));
}

TEST_F(SuiteJobs, TableAndJsonNameEveryJob) {
    SuiteLine finished = line_, failed = line_, missing = line_;
    finished.result = finished_job(line_.job.options);
    failed.row = "ADC", failed.error = "a|b\nc";
    missing.row = "MCMC 0.1x";
    const std::vector<SuiteLine> lines = {finished, failed, missing};
    const std::string table = format_suite(lines);
    EXPECT_NE(table.find("| MCMC | sh         | 20.50 | 0.7500 | 123 |         4.0 | 2.0 | 0.0 |"), std::string::npos)
        << table;
    EXPECT_NE(table.find("- ADC, sh: failed: a|b c\n"), std::string::npos) << table;
    EXPECT_NE(table.find("- MCMC 0.1x, sh: not trained\n"), std::string::npos) << table;
    write_suite(tmp_.path(), "densification", lines);
    std::ifstream json(tmp_.path() / "suite.json");
    const std::string text{std::istreambuf_iterator<char>(json), {}};
    for (const char* part : {"\"suite\": \"densification\"", "\"status\": \"finished\"", "\"status\": \"failed\"",
                             "\"status\": \"not trained\"", "\"bytes\": 10"})
        EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
    EXPECT_TRUE(std::filesystem::exists(tmp_.path() / "suite.md"));
}

// A suite whose jobs nobody trains: what is written, and when.

class SuiteRunTest : public ::testing::Test {
  protected:
    SuiteRunTest() {
        base_.source = "builtin:diffuse", base_.iterations = 20, base_.model = (tmp_.path() / "out").string();
    }

    std::string table() const {
        std::ifstream file(tmp_.path() / "out" / "suite.md");
        return {std::istreambuf_iterator<char>(file), {}};
    }
    test::TemporaryFolder tmp_;
    TrainOptions base_;
};

TEST_F(SuiteRunTest, WritesTheTableAfterEveryJob) {
    std::vector<std::string> tables;
    const auto trainer = [&](const std::vector<Job>& jobs, const JobHooks& hooks) {
        EXPECT_EQ(jobs.size(), 4u);
        EXPECT_EQ(jobs[0].name, "MCMC, sh");
        tables.push_back(table());
        RunResult result;
        result.psnr = 21, result.num_gaussians = 5, result.train_seconds = 4, result.bytes = 10;
        hooks.done(1, {.result = result});
        tables.push_back(table());
        hooks.done(0, {.error = "out of memory", .code = ExitCode::kDevice});
        return JobsSummary{.num_failed = 1, .first_code = ExitCode::kDevice};
    };
    const SuiteRun done = run_suite("densification", {"sh"}, base_, trainer);
    EXPECT_EQ(done.folder, tmp_.path() / "out");
    EXPECT_EQ(done.summary.num_failed, 1);
    EXPECT_EQ(done.lines[0].error, "out of memory");
    EXPECT_EQ(done.lines[1].result->psnr, 21);
    EXPECT_FALSE(done.lines[2].result);
    ASSERT_EQ(tables.size(), 2u);
    EXPECT_EQ(tables[0].find("21.00"), std::string::npos);
    EXPECT_NE(tables[1].find("| MCMC 0.1x | sh         | 21.00 |"), std::string::npos) << tables[1];
    EXPECT_EQ(table(), format_suite(done.lines));
}

TEST_F(SuiteRunTest, MistakesComeBeforeAnyFile) {
    const auto untouched = [](const std::vector<Job>&, const JobHooks&) -> JobsSummary {
        throw std::logic_error("nothing was to be trained");
    };
    EXPECT_THROW(run_suite("everything", {"sh"}, base_, untouched), UsageError);
    EXPECT_THROW(run_suite("densification", {}, base_, untouched), UsageError);
    base_.resume = "latest";
    EXPECT_THROW(run_suite("densification", {"sh"}, base_, untouched), UsageError);
    EXPECT_FALSE(std::filesystem::exists(tmp_.path() / "out"));
}

// Runs with several seeds: which are trained, and in which folders; and the folder of a run that names none.

TrainOptions seeded_options() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = "out/run";
    o.seed = 5;
    o.eval = true;
    return o;
}

TEST(Seeds, EachRunHasItsSeedAndItsFolder) {
    std::vector<std::pair<std::uint64_t, std::string>> trained;
    const auto rows = train_seeds(seeded_options(), 3, [&](const TrainOptions& options) -> std::optional<RunResult> {
        trained.push_back({options.seed, options.model});
        if (options.seed == 6) return std::nullopt;  // nothing was scored
        RunResult row;
        row.psnr = double(options.seed);
        return row;
    });
    EXPECT_EQ(trained, (std::vector<std::pair<std::uint64_t, std::string>>{
                           {5, "out/run-0"}, {6, "out/run-1"}, {7, "out/run-2"}}));
    ASSERT_EQ(rows.size(), 2u);
    EXPECT_EQ(rows[1].psnr, 7);
}

TEST(Seeds, MistakesComeBeforeAnyTraining) {
    const auto untouched = [](const TrainOptions&) -> std::optional<RunResult> {
        throw std::logic_error("nothing was to be trained");
    };
    TrainOptions resumed = seeded_options(), chosen = seeded_options(), unscored = seeded_options();
    resumed.resume = "latest", chosen.appearance = kAutoAppearance, unscored.eval = false;
    for (const TrainOptions& options : {resumed, chosen, unscored})
        EXPECT_THROW(train_seeds(options, 2, untouched), UsageError);
}

TEST(FreeRunFolder, IsTheFirstNumberThatIsNotTaken) {
    const test::TemporaryFolder tmp;
    const auto name = [&](const std::string& last) { return (tmp.path() / last).string(); };
    EXPECT_EQ(free_run_folder(tmp.path(), seeded_options()), name("diffuse-sh-1"));
    std::filesystem::create_directory(name("diffuse-sh-1"));
    std::filesystem::create_directory(name("diffuse-sh-2-0"));
    EXPECT_EQ(free_run_folder(tmp.path(), seeded_options()), name("diffuse-sh-2"));
    EXPECT_EQ(free_run_folder(tmp.path(), seeded_options(), "-0"), name("diffuse-sh-1"));
}

TEST(LogLevel, QuietBeatsVerbose) {
    TrainOptions options;
    EXPECT_EQ(shown_messages(options), LogLevel::kInfo);
    options.verbose = true;
    EXPECT_EQ(shown_messages(options), LogLevel::kDebug);
    options.quiet = true;
    EXPECT_EQ(shown_messages(options), LogLevel::kWarn);
}

}  // namespace
}  // namespace gs
