// SPDX-License-Identifier: Apache-2.0
// A suite whose cells nobody trains: what is written, and when.
#include "eval/experiments/suite.h"

#include <gtest/gtest.h>

#include <fstream>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

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

TEST_F(SuiteRunTest, WritesTheTableAfterEveryCell) {
    std::vector<std::string> tables;
    const auto trainer = [&](const std::vector<Cell>& cells, const CellHooks& hooks) {
        EXPECT_EQ(cells.size(), 4u);
        EXPECT_EQ(cells[0].name, "MCMC, sh");
        tables.push_back(table());
        hooks.done(1, {.result = CellResult{.psnr = 21, .num_gaussians = 5}});
        tables.push_back(table());
        hooks.done(0, {.error = "out of memory", .code = ExitCode::kDevice});
        return CellsSummary{.num_failed = 1, .first_code = ExitCode::kDevice};
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
    const auto untouched = [](const std::vector<Cell>&, const CellHooks&) -> CellsSummary {
        throw std::logic_error("nothing was to be trained");
    };
    EXPECT_THROW(run_suite("everything", {"sh"}, base_, untouched), UsageError);
    EXPECT_THROW(run_suite("densification", {}, base_, untouched), UsageError);
    base_.resume = "latest";
    EXPECT_THROW(run_suite("densification", {"sh"}, base_, untouched), UsageError);
    EXPECT_FALSE(std::filesystem::exists(tmp_.path() / "out"));
}

}  // namespace
}  // namespace gs
