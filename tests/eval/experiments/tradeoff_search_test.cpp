// SPDX-License-Identifier: Apache-2.0
// The plan of a trade-off and its search, with made-up results in place of trainings.
#include "eval/experiments/tradeoff_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using Clock = std::chrono::steady_clock;

/// Better and dearer with more iterations and, at equal iterations, with sh.
CellOutcome outcome_of(const TrainOptions& options) {
    const double cost = double(options.iterations) + (options.appearance == "sh" ? 1 : 0);
    return {.result = CellResult{20 + cost, 0.5, 100, cost, cost, std::int64_t(cost), std::nullopt, "made up"},
            .wall_seconds = cost};
}

/// Ends every cell it is let choose by `outcome`.
CellsRunner trainer(std::function<CellOutcome(const TrainOptions&)> outcome) {
    return [outcome](const std::vector<Cell>& cells, const CellHooks& hooks) {
        CellsSummary summary;
        std::vector<std::size_t> pending;
        for (std::size_t k = 0; k < cells.size(); ++k) pending.push_back(k);
        while (!pending.empty()) {
            const std::optional<std::size_t> k = hooks.choose(pending);
            if (!k) break;
            std::erase(pending, *k);
            const CellOutcome o = outcome(cells[*k].options);
            if (!o.error.empty() && summary.num_failed++ == 0) summary.first_code = o.code;
            hooks.done(*k, o);
        }
        return summary;
    };
}

class TradeoffSearchTest : public ::testing::Test {
  protected:
    TradeoffSearchTest() {
        base_.source = "builtin:diffuse", base_.resolution = 8, base_.device = Device::kCpu;
        base_.iterations = 8, base_.init_points = 100, base_.cap_max = 10000;
        base_.model = (tmp_.path() / "out").string();
    }
    std::vector<RunState> states(const Tradeoff& tradeoff) const {
        std::vector<RunState> states;
        for (const TradeoffRun& run : tradeoff.runs) states.push_back(run.state);
        return states;
    }
    test::TemporaryFolder tmp_;
    TrainOptions base_;
};

TEST_F(TradeoffSearchTest, PlansWithoutWritingAnything) {
    const TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}, .quality = Quality::kSsim});
    EXPECT_EQ(plan.folder, tmp_.path() / "out");
    EXPECT_EQ(plan.tradeoff.give_up, 0.02);
    EXPECT_EQ(plan.rounds.size(), 1u);
    EXPECT_TRUE(plan.tradeoff.runs.empty());
    EXPECT_TRUE(plan.tradeoff.remarks.empty());
    EXPECT_FALSE(std::filesystem::exists(plan.folder));
    EXPECT_EQ(plan_tradeoff(base_, {.axes = {"appearance=none,sh"}, .give_up = 3}).tradeoff.give_up, 3);
}

TEST_F(TradeoffSearchTest, RemarksOnBudgetsBelowTheScenesPoints) {
    const TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh", "budget=0.0001,1"}});
    ASSERT_EQ(plan.tradeoff.remarks.size(), 1u);
    EXPECT_EQ(plan.tradeoff.remarks[0].find("2 of 4 configurations have a --cap-max below the "), 0u)
        << plan.tradeoff.remarks[0];
}

TEST_F(TradeoffSearchTest, RefusesWhatCannotBeCompared) {
    TrainOptions resumed = base_;
    resumed.resume = "latest";
    EXPECT_THROW(plan_tradeoff(resumed, {.axes = {"appearance=none,sh"}}), UsageError);
    EXPECT_THROW(plan_tradeoff(base_, {.axes = {"appearance=sh"}}), UsageError);
    TrainOptions nowhere = base_;
    nowhere.source = "nowhere";
    EXPECT_THROW(plan_tradeoff(nowhere, {.axes = {"appearance=none,sh"}}), DataError);
}

TEST_F(TradeoffSearchTest, TrainsEveryConfigurationAndKeepsFailures) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}});
    const CellsSummary summary = search_tradeoff(
        plan, std::nullopt, trainer([](const TrainOptions& options) {
            return options.appearance == "none" ? CellOutcome{.error = "broken", .code = ExitCode::kNumeric}
                                                : outcome_of(options);
        }));
    EXPECT_EQ(summary.num_failed, 1);
    EXPECT_EQ(summary.first_code, ExitCode::kNumeric);
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kFailed, RunState::kFinished}));
    EXPECT_EQ(plan.tradeoff.runs[0].error, "broken");
    EXPECT_EQ(plan.tradeoff.runs[1].result->psnr, 29);
    for (const char* file : {"tradeoff.md", "tradeoff.html", "tradeoff.json"})
        EXPECT_TRUE(std::filesystem::exists(plan.folder / file)) << file;
}

TEST_F(TradeoffSearchTest, HalvingGoesOnWithTheBetterHalf) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh,nasg"}, .search = SearchKind::kHalving});
    // nasg costs as much as none and is worse, so that it is the one to go.
    search_tradeoff(plan, std::nullopt, trainer([](const TrainOptions& options) {
                        CellOutcome outcome = outcome_of(options);
                        if (options.appearance == "nasg") outcome.result->psnr -= 5;
                        return outcome;
                    }));
    std::vector<std::string> trained;
    for (const TradeoffRun& run : plan.tradeoff.runs)
        trained.push_back(run.configuration.options.appearance + " " + run.configuration.values.back());
    ASSERT_EQ(trained.size(), 6u) << "three, then two, then one";
    EXPECT_EQ(
        std::count_if(trained.begin() + 3, trained.end(), [](const std::string& t) { return t.starts_with("nasg"); }),
        0);
    EXPECT_TRUE(trained.back().ends_with(" 8")) << trained.back();
}

TEST_F(TradeoffSearchTest, HalvingStopsAfterARoundWithoutTime) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}, .search = SearchKind::kHalving});
    search_tradeoff(plan, Clock::now() + std::chrono::hours(1), trainer([](const TrainOptions& options) {
                        CellOutcome outcome = outcome_of(options);
                        outcome.result->train_seconds = 1e6;  // the next one would not end within the hour
                        return outcome;
                    }));
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kFinished, RunState::kNoTime}));
    ASSERT_EQ(plan.tradeoff.remarks.size(), 1u);
    EXPECT_NE(plan.tradeoff.remarks[0].find("ended in round 1 of 3"), std::string::npos);
}

TEST_F(TradeoffSearchTest, ARunThatTheDeadlineEndsIsMarkedAsStopped) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}});
    search_tradeoff(plan, Clock::now(), [](const std::vector<Cell>&, const CellHooks& hooks) {
        hooks.done(0, {.wall_seconds = 1});
        return CellsSummary{};
    });
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kStopped, RunState::kNoTime}));
}

TEST_F(TradeoffSearchTest, WhatAnInterruptLeftIsNotReached) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}});
    const CellsSummary summary =
        search_tradeoff(plan, std::nullopt, [](const std::vector<Cell>& cells, const CellHooks& hooks) {
            hooks.done(0, outcome_of(cells[0].options));
            return CellsSummary{.interrupted = true};
        });
    EXPECT_TRUE(summary.interrupted);
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kFinished, RunState::kNotReached}));
}

}  // namespace
}  // namespace gs
