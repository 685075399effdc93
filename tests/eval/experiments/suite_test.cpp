// SPDX-License-Identifier: Apache-2.0
// The grids of the suites, and which run folders count as finished.
#include "eval/experiments/suite.h"
#include "eval/report/table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "kernels/core/error.h"
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
    const auto cells = suite_cells("densification", {"sh", "neural"}, base_options());
    ASSERT_EQ(cells.size(), 8u);
    const auto& mcmc = cells[0].options;
    EXPECT_EQ(cells[0].row, "MCMC");
    EXPECT_EQ(mcmc.model, "out/mcmc-sh");
    EXPECT_TRUE(mcmc.eval);
    EXPECT_EQ(mcmc.cap_max, 5005);
    EXPECT_EQ(mcmc.densify_until_iter, 24900);
    EXPECT_EQ(mcmc.opacity_lr, 0.05);
    EXPECT_EQ(cells[1].options.cap_max, 501) << "a tenth, rounded";
    EXPECT_EQ(cells[1].options.strategy, Strategy::kMcmc);
    EXPECT_EQ(cells[2].options.strategy, Strategy::kAdc);
    EXPECT_EQ(cells[2].options.densify_until_iter, 14900) << "decided by the cell's own strategy";
    EXPECT_EQ(cells[2].options.opacity_lr, 0.025);
    EXPECT_FALSE(cells[2].options.speedy_splat);
    EXPECT_TRUE(cells[3].options.speedy_splat);
    EXPECT_EQ(cells[3].options.opacity_lr, 0.05);
    EXPECT_EQ(cells[7].appearance, "neural");
    EXPECT_EQ(cells[7].options.appearance, "neural");
    EXPECT_EQ(cells[7].options.model, "out/adc-speedy-neural");
    EXPECT_EQ(cells[7].options.iterations, 20) << "what the suite does not vary is the caller's";
}

TEST(Suite, ActivationsVaryTheFunctionAndTheOpacityRate) {
    const auto cells = suite_cells("activations", {"sh"}, base_options());
    ASSERT_EQ(cells.size(), 12u);
    EXPECT_EQ(cells[4].row, "softplus, opacity rate 0.025");
    EXPECT_EQ(cells[4].options.color_activation, ColorActivation::kSoftplus);
    EXPECT_EQ(cells[4].options.opacity_lr, 0.025);
    EXPECT_TRUE(std::isnan(cells[11].options.opacity_lr));
    EXPECT_EQ(cells[11].options.model, "out/hardsigmoid-auto-sh");
}

TEST(Suite, MistakesAreUsageErrors) {
    EXPECT_THROW(suite_cells("everything", {"sh"}, base_options()), UsageError);
    EXPECT_THROW(suite_cells("activations", {"sj"}, base_options()), UsageError);
    EXPECT_THROW(suite_cells("activations", {"sh", "auto"}, base_options()), UsageError);
    TrainOptions nowhere = base_options();
    nowhere.source.clear();
    EXPECT_THROW(suite_cells("activations", {"sh"}, nowhere), UsageError);
}

class SuiteCells : public ::testing::Test {
  protected:
    SuiteCells() {
        TrainOptions base = base_options();
        base.model = tmp_.path().string();
        cell_ = suite_cells("densification", {"sh"}, base)[0];
        write("config.yaml", options_to_yaml(cell_.options));
        write("point_cloud/iteration_20/point_cloud.ply", "0123456789");
        write("results.json", R"({"ours_20": {"PSNR": 20.5, "SSIM": 0.75}, "num_gaussians": {"ours_20": 123},
                                 "timing": {"ours_20": {"train_seconds": 4, "frame_seconds": 0.5}}})");
    }
    void write(const std::string& name, const std::string& text) {
        const auto file = std::filesystem::path(cell_.options.model) / name;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file) << text;
    }
    test::TemporaryFolder tmp_;
    SuiteCell cell_;
};

TEST_F(SuiteCells, AFinishedRunOfTheSameOptionsIsTaken) {
    cell_.options.quiet = true; // changes no figure
    const auto result = finished_cell(cell_.options);
    ASSERT_TRUE(result);
    EXPECT_EQ(result->psnr, 20.5);
    EXPECT_EQ(result->ssim, 0.75);
    EXPECT_EQ(result->num_gaussians, 123);
    EXPECT_EQ(result->train_seconds, 4);
    EXPECT_EQ(result->frame_seconds, 0.5);
    EXPECT_EQ(result->bytes, 10);
}

TEST_F(SuiteCells, AnotherRunOrABrokenOneIsNot) {
    SuiteCell other = cell_;
    other.options.seed = 7;
    EXPECT_FALSE(finished_cell(other.options));
    EXPECT_FALSE(holds_same_run(other.options));
    other = cell_;
    other.options.source = "builtin:glossy";
    EXPECT_FALSE(finished_cell(other.options));
    write("results.json", R"({"ours_20": {"PSNR": 20.5, "SSIM": 0.75}, "num_gaussians": {"ours_20": 123}})");
    EXPECT_FALSE(finished_cell(cell_.options)) << "the times come last";
    EXPECT_TRUE(holds_same_run(cell_.options));
    write("results.json", "{");
    EXPECT_FALSE(finished_cell(cell_.options));
    write("config.yaml", "what: ever\n");
    EXPECT_FALSE(holds_same_run(cell_.options));
    other.options.model = (tmp_.path() / "nothing").string();
    EXPECT_FALSE(holds_same_run(other.options));
}

TEST_F(SuiteCells, TableAndJsonNameEveryCell) {
    SuiteCell failed = cell_, missing = cell_;
    failed.row = "ADC", missing.row = "MCMC 0.1x";
    const std::vector<SuiteLine> lines = {{cell_, finished_cell(cell_.options), ""}, {failed, std::nullopt, "a|b\nc"}, {missing, std::nullopt, ""}};
    const std::string table = format_suite(lines);
    EXPECT_NE(table.find("| MCMC | sh | 20.50 | 0.7500 | 123 | 4.0 | 2.0 | 0.0 |"), std::string::npos) << table;
    EXPECT_NE(table.find("| ADC | sh | failed: a/b c |"), std::string::npos) << table;
    EXPECT_NE(table.find("| MCMC 0.1x | sh | not trained |"), std::string::npos) << table;
    write_suite(tmp_.path(), "densification", lines);
    std::ifstream json(tmp_.path() / "suite.json");
    const std::string text{std::istreambuf_iterator<char>(json), {}};
    for (const char* part : {"\"suite\": \"densification\"", "\"status\": \"finished\"", "\"status\": \"failed\"", "\"status\": \"not trained\"", "\"bytes\": 10"})
        EXPECT_NE(text.find(part), std::string::npos) << part << "\n" << text;
    EXPECT_TRUE(std::filesystem::exists(tmp_.path() / "suite.md"));
}

}  // namespace
}  // namespace gs
