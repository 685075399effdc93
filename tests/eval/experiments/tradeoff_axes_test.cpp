// SPDX-License-Identifier: Apache-2.0
// Axes as users write them, the grid they span, and the rounds of a search.
#include "eval/experiments/tradeoff_axes.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <functional>
#include <set>

#include "eval/experiments/tradeoff_plan.h"
#include "eval/experiments/tradeoff_search.h"
#include "kernels/base/error.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using Words = std::vector<std::string>;
using Clock = std::chrono::steady_clock;

TrainOptions base_options() {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.model = "out";
    o.iterations = 8000;
    o.cap_max = 200000;
    return o;
}

std::string error_of(const std::function<void()>& act) {
    try {
        act();
    } catch (const UsageError& e) {
        return e.what();
    }
    return "no error";
}

std::vector<TradeoffAxis> parse(const Words& words) { return parse_axes(words, base_options()); }

TEST(TradeoffAxes, AreNamesWithValuesOrWithDefaults) {
    const auto axes = parse({"appearance=none,sh", "budget,iterations", "speedy_splat", "color-activation"});
    ASSERT_EQ(axes.size(), 5u);
    EXPECT_EQ(axes[0].name, "appearance");
    EXPECT_EQ(axes[0].values, (Words{"none", "sh"}));
    EXPECT_EQ(axes[1].values, (Words{"0.1", "0.3", "1"}));
    EXPECT_EQ(axes[2].values, (Words{"2000", "8000"}));
    EXPECT_EQ(axes[3].name, "speedy-splat");
    EXPECT_EQ(axes[3].values, (Words{"false", "true"}));
    EXPECT_EQ(axes[4].values, (Words{"relu", "softplus", "sigmoid", "hardsigmoid"}));
}

TEST(TradeoffAxes, TimeAndSizeAreLimits) {
    const auto axes = parse({"time=5s,10s", "size=1MB,2MB"});
    ASSERT_EQ(axes.size(), 2u);
    EXPECT_EQ(axes[0].name, "time-limit");
    EXPECT_EQ(axes[1].name, "size-limit");
    const Configuration c = make_configuration(axes, {"5s", "2MB"}, base_options());
    EXPECT_EQ(c.options.time_limit, parse_duration("5s", ""));
    EXPECT_EQ(c.options.size_limit, parse_bytes("2MB", ""));
    EXPECT_EQ(c.options.recipe, Recipe::kFrontier);
    const auto both = parse({"time=5s", "iterations=10"});
    EXPECT_NE(error_of([&] {
                  make_configuration(both, {"5s", "10"}, base_options());
              }).find("--axes iterations"),
              std::string::npos);
    EXPECT_NE(error_of([&] {
                  make_configuration(axes, {"soon", "2MB"}, base_options());
              }).find("time-limit"),
              std::string::npos);
}

TEST(TradeoffAxes, PrecisionHasNames) {
    TrainOptions base = base_options();
    base.device = Device::kCpu;
    const auto axes = parse_axes({"precision"}, base);
    EXPECT_EQ(axes.at(0).values, (Words{"full", "cutoffs"}));
    const Configuration c = make_configuration(axes, {"cutoffs"}, base);
    EXPECT_EQ(c.options.alpha_cutoff, 2);
    EXPECT_EQ(c.options.appearance_storage, AppearanceStorage::kFp32);
    EXPECT_NE(error_of([&] { make_configuration(axes, {"fast"}, base); }).find("on a GPU only"), std::string::npos);
    EXPECT_NE(error_of([&] { make_configuration(axes, {"fastest"}, base); }).find("'fastest' is not one of full"),
              std::string::npos);
}

TEST(TradeoffAxes, MistakesAreNamed) {
    const auto error = [](const Words& words) { return error_of([&] { parse(words); }); };
    EXPECT_NE(error({"apearance=sh"}).find("did you mean 'appearance'"), std::string::npos);
    EXPECT_NE(error({"budgets"}).find("did you mean 'budget'"), std::string::npos);
    EXPECT_NE(error({"budget", "budget=1"}).find("budget is given twice"), std::string::npos);
    EXPECT_NE(error({"budget=,"}).find("budget has no values"), std::string::npos);
    EXPECT_NE(error({"scaling-lr"}).find("scaling-lr=A,B"), std::string::npos);
    for (const char* name : {"resolution=80,160", "source=a,b", "seed=0,1", "device=cpu,cuda", "background=black,white",
                             "quiet", "test-iterations=5,6"})
        EXPECT_NE(error({name}).find("cannot be an axis"), std::string::npos) << name;
}

TEST(TradeoffAxes, ValuesAreCheckedByTheirOptions) {
    const auto error = [](const Words& words) { return error_of([&] { spread_grid(parse(words), base_options()); }); };
    EXPECT_NE(error({"appearance=sh,shh"}).find("option appearance: 'shh'"), std::string::npos);
    EXPECT_NE(error({"iterations=100,ten"}).find("--axes iterations: 'ten'"), std::string::npos);
    EXPECT_NE(error({"sh-degree=0,9"}).find("option sh-degree: 9 is out of range"), std::string::npos);
    for (const char* share : {"0", "2", "-0.1", "nan", "half"})
        EXPECT_NE(error({std::string("budget=1,") + share}).find("'" + std::string(share) + "' is not a share"),
                  std::string::npos)
            << share;
    EXPECT_NE(error({"speedy-splat"}).find("goes with strategy adc"), std::string::npos);
    EXPECT_NE(error({"appearance=sh,auto"}).find("appearance auto: every run that is compared"), std::string::npos);
    EXPECT_NE(error({"appearance=sh"}).find("one configuration only"), std::string::npos);
    EXPECT_NE(error({"budget=0.5,0.50"}).find("are the same training"), std::string::npos);
    TrainOptions undecided = base_options();
    undecided.appearance = "auto";
    EXPECT_NE(error_of([&] {
                  spread_grid(parse({"budget"}), undecided);
              }).find("appearance auto: every run that is compared"),
              std::string::npos);
    std::string values = "1";
    for (int i = 2; i <= 40; ++i) values += "," + std::to_string(i);
    EXPECT_NE(error({"iterations=" + values, "cap-max=" + values}).find("more than 1000"), std::string::npos);
}

TEST(TradeoffAxes, AConfigurationIsItsValuesOnTopOfTheBase) {
    const auto axes = parse({"budget=0.1,1", "cap-max=50000,90000", "strategy=mcmc,adc"});
    const Configuration c = make_configuration(axes, {"0.1", "90000", "adc"}, base_options());
    EXPECT_EQ(c.options.cap_max, 9000) << "a share of the cap, whichever axis comes first";
    EXPECT_EQ(c.options.init_points, 9000);
    EXPECT_EQ(c.options.opacity_lr, 0.025) << "decided by the configuration's own strategy";
    EXPECT_TRUE(c.options.eval);
    EXPECT_EQ(c.options.model, "out/budget-0.1_cap-max-90000_strategy-adc");
    EXPECT_EQ(configuration_name(axes, c), "budget 0.1, cap-max 90000, strategy adc");
}

TEST(TradeoffAxes, TheGridBeginsCheapAndSpreads) {
    const auto axes = parse({"appearance=none,sh", "budget=1,0.1,0.3", "iterations=8000,2000"});
    const auto grid = spread_grid(axes, base_options());
    ASSERT_EQ(grid.size(), 12u);
    EXPECT_EQ(grid[0].values, (Words{"none", "0.1", "2000"})) << "fewest iterations and Gaussians";
    EXPECT_EQ(grid[1].values, (Words{"sh", "1", "8000"})) << "differs in everything";
    std::set<Words> all;
    for (const Configuration& c : grid) all.insert(c.values);
    EXPECT_EQ(all.size(), 12u);
    // Any start of the list has all values of the short axes, and both ends of the others.
    std::set<std::string> early[3];
    for (std::size_t k = 0; k < 4; ++k)
        for (std::size_t a = 0; a < 3; ++a) early[a].insert(grid[k].values[a]);
    EXPECT_EQ(early[0].size(), 2u);
    EXPECT_TRUE(early[1].contains("0.1") && early[1].contains("1"));
    EXPECT_EQ(early[2].size(), 2u);
}

TEST(TradeoffRounds, AGridIsOneRoundWithThreeAxesByDefault) {
    std::vector<TradeoffAxis> axes;
    const Rounds rounds = plan_grid({}, base_options(), axes);
    ASSERT_EQ(rounds.size(), 1u);
    EXPECT_EQ(rounds[0].size(), 24u);
    EXPECT_EQ(axes.size(), 3u);
}

TEST(TradeoffRounds, HalvingTrainsTheSameConfigurationsLongerEachTime) {
    std::vector<TradeoffAxis> axes;
    TrainOptions base = base_options();
    base.iterations = 1001;
    const Rounds rounds = plan_halving({"appearance=none,sh"}, base, axes);
    ASSERT_EQ(rounds.size(), 3u);
    ASSERT_EQ(axes.size(), 2u);
    EXPECT_EQ(axes[1].name, "iterations");
    EXPECT_EQ(axes[1].values, (Words{"251", "501", "1001"}));
    for (std::size_t r = 0; r < 3; ++r) {
        ASSERT_EQ(rounds[r].size(), 2u);
        for (std::size_t i = 0; i < 2; ++i) {
            EXPECT_EQ(rounds[r][i].values, (Words{rounds[0][i].values[0], axes[1].values[r]}));
            EXPECT_EQ(std::to_string(rounds[r][i].options.iterations), axes[1].values[r]);
        }
    }
    EXPECT_NE(
        error_of([&] { plan_halving({"appearance,iterations"}, base, axes); }).find("halving varies the iterations"),
        std::string::npos);
    base.iterations = 3;
    EXPECT_NE(error_of([&] { plan_halving({}, base, axes); }).find("at least 4"), std::string::npos);
}

// The plan of a trade-off and its search, with made-up results in place of trainings.

/// Better and dearer with more iterations and, at equal iterations, with sh.
JobOutcome outcome_of(const TrainOptions& options) {
    const double cost = double(options.iterations) + (options.appearance == "sh" ? 1 : 0);
    RunResult result;
    result.psnr = 20 + cost, result.ssim = 0.5, result.num_gaussians = 100;
    result.train_seconds = result.frame_seconds = cost, result.bytes = std::int64_t(cost);
    result.protocol = {{"line", "made up"}};
    return {.result = result, .wall_seconds = cost};
}

/// Ends every job it is let choose by `outcome`.
JobsRunner trainer(std::function<JobOutcome(const TrainOptions&)> outcome) {
    return [outcome](const std::vector<Job>& jobs, const JobHooks& hooks) {
        JobsSummary summary;
        std::vector<std::size_t> pending;
        for (std::size_t k = 0; k < jobs.size(); ++k) pending.push_back(k);
        while (!pending.empty()) {
            const std::optional<std::size_t> k = hooks.choose(pending);
            if (!k) break;
            std::erase(pending, *k);
            const JobOutcome o = outcome(jobs[*k].options);
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
    const JobsSummary summary = search_tradeoff(
        plan, std::nullopt, trainer([](const TrainOptions& options) {
            return options.appearance == "none" ? JobOutcome{.error = "broken", .code = ExitCode::kNumeric}
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
                        JobOutcome outcome = outcome_of(options);
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
                        JobOutcome outcome = outcome_of(options);
                        outcome.result->train_seconds = 1e6;  // the next one would not end within the hour
                        return outcome;
                    }));
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kFinished, RunState::kNoTime}));
    ASSERT_EQ(plan.tradeoff.remarks.size(), 1u);
    EXPECT_NE(plan.tradeoff.remarks[0].find("ended in round 1 of 3"), std::string::npos);
}

TEST_F(TradeoffSearchTest, ARunThatTheDeadlineEndsIsMarkedAsStopped) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}});
    search_tradeoff(plan, Clock::now(), [](const std::vector<Job>&, const JobHooks& hooks) {
        hooks.done(0, {.wall_seconds = 1});
        return JobsSummary{};
    });
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kStopped, RunState::kNoTime}));
}

TEST_F(TradeoffSearchTest, WhatAnInterruptLeftIsNotReached) {
    TradeoffPlan plan = plan_tradeoff(base_, {.axes = {"appearance=none,sh"}});
    const JobsSummary summary =
        search_tradeoff(plan, std::nullopt, [](const std::vector<Job>& jobs, const JobHooks& hooks) {
            hooks.done(0, outcome_of(jobs[0].options));
            return JobsSummary{.interrupted = true};
        });
    EXPECT_TRUE(summary.interrupted);
    EXPECT_EQ(states(plan.tradeoff), (std::vector<RunState>{RunState::kFinished, RunState::kNotReached}));
}

}  // namespace
}  // namespace gs
