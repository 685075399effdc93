// SPDX-License-Identifier: Apache-2.0
// A run with one Gaussian pruned, and its report.
#include "eval/runs/prune_run.h"

#include <gtest/gtest.h>

#include <fstream>

#include "kernels/core/error.h"
#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

TEST(PruneRun, WritesARunThatOpensAndSaysWhatChanged) {
    const test::TinyRun saved(test::one_sh_gaussian(0.001f));  // too little to show
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    const std::filesystem::path output = pruned_folder(saved.path());
    const PruneReport report = prune_run(run, output);
    EXPECT_EQ(report.run, saved.path());
    EXPECT_EQ(report.pruned, 1);
    EXPECT_EQ(report.num_gaussians, 1);
    EXPECT_EQ(report.bytes_saved, 9 * 4);
    EXPECT_EQ(report.num_cameras, run.scene.train.size());
    ASSERT_TRUE(report.before && report.after);
    EXPECT_NEAR(report.before->psnr, report.after->psnr, 0.1);

    SavedRun pruned = open_saved_run(output, std::nullopt);
    EXPECT_EQ(pruned.iteration, 100);
    EXPECT_EQ(pruned.options.model, output);
    EXPECT_EQ(pruned.backend->num_residuals(), 0);
    EXPECT_EQ(pruned.backend->download(false)[Group::kResidual].param, std::vector<float>());
    const PruneReport again = prune_run(pruned, saved.folder.path() / "again");
    EXPECT_EQ(again.pruned, 0) << "there is nothing left to take";
    std::ifstream file(output / "pruned.json");
    EXPECT_EQ(nlohmann::ordered_json::parse(file), prune_report_json(report));
}

TEST(PruneRun, HasNoScoresWithoutTestViews) {
    const test::TinyRun saved(test::one_sh_gaussian(0.001f), false);
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    const PruneReport report = prune_run(run, saved.folder.path() / "pruned");
    EXPECT_FALSE(report.before);
    EXPECT_NE(format_prune_report(report).find("there are no test views"), std::string::npos);
    EXPECT_FALSE(prune_report_json(report).contains("before"));
}

TEST(PruneRun, RefusesAModelWithoutResiduals) {
    const test::TinyRun saved;
    SavedRun run = open_saved_run(saved.path(), std::nullopt);
    EXPECT_THROW(prune_run(run, saved.folder.path() / "pruned"), UsageError);
    EXPECT_FALSE(std::filesystem::exists(saved.folder.path() / "pruned"));
}

TEST(PruneRun, ReportsSharesAndScores) {
    PruneReport report{
        .run = "run/", .iteration = 10, .num_gaussians = 200, .pruned = 50, .bytes_saved = 1000, .num_cameras = 7};
    report.before = PruneScores{30.0, 0.9}, report.after = PruneScores{29.5, 0.89};
    EXPECT_EQ(format_prune_report(report),
              "50 of 200 Gaussians (25.0 %) show their view dependence in none of 7 training views and lose it: 1000 "
              "bytes less\n"
              "test views: PSNR 30.000 before, 29.500 after; SSIM 0.90000 before, 0.89000 after\n");
    EXPECT_EQ(prune_report_json(report)["share"], 0.25);
    EXPECT_EQ(prune_report_json(report)["after"]["PSNR"], 29.5);
    EXPECT_EQ(pruned_folder("out/run/"), "out/run-pruned");
    EXPECT_EQ(pruned_folder("out/run"), "out/run-pruned");
}

}  // namespace
}  // namespace gs
