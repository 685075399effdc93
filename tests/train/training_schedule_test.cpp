// SPDX-License-Identifier: Apache-2.0
// Schedules that follow the length of a run, and runs that follow a clock.
#include "lib/train/training_schedule.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/densification.h"
#include "lib/train/learning_rates.h"
#include "lib/train/run_costs.h"
#include "lib/train/train_log.h"
#include "tests/io/file_helpers.h"
#include "tests/io/limits.h"
#include "tests/kernels/forwarding_engine.h"

namespace gs::test {
namespace {

TrainOptions options_of(std::int64_t iterations, ScheduleKind schedule = ScheduleKind::kProgress) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.iterations = iterations, o.schedule = schedule;
    o = resolve(o);
    return o;
}

TEST(Timeline, ARunOfTheReferenceLengthCountsIterations) {
    const TrainOptions o = options_of(30000);
    for (const std::int64_t k : {0, 1, 599, 24900, 29999}) {
        EXPECT_EQ(moment_at(o, k).position, double(k));
        EXPECT_EQ(moment_at(o, k).before, double(k - 1));
    }
}

TEST(Timeline, OtherLengthsAreStretchedUnlessTheScheduleIsFixed) {
    EXPECT_EQ(moment_at(options_of(7500), 100).position, 400);
    EXPECT_EQ(moment_at(options_of(7500), 100).stride(), 4);
    EXPECT_EQ(moment_at(options_of(60000), 100).position, 50);
    EXPECT_EQ(moment_at(options_of(7500, ScheduleKind::kFixed), 100).position, 100);
}

TEST(Timeline, MultiplesArePassedOnce) {
    for (const std::int64_t iterations : {100, 2999, 7500, 30000, 47001}) {
        const TrainOptions o = options_of(iterations);
        std::int64_t passed = 0;
        for (std::int64_t k = 0; k < iterations; ++k) {
            const ScheduleMoment m = moment_at(o, k);
            passed += multiples_passed(m.before, m.position, 1000);
        }
        EXPECT_EQ(passed, iterations < 30 ? 1 : 30) << iterations;  // 0, 1000, ..., 29000
    }
}

TEST(Timeline, AMarkThatWasNamedCountsIterations) {
    const ScheduleMoment m{50, 400, 392};
    EXPECT_TRUE(ScheduleMark({}, 400).reached(m));
    EXPECT_FALSE(ScheduleMark({}, 401).reached(m));
    EXPECT_TRUE(ScheduleMark(50, 99999).reached(m));
    EXPECT_FALSE(ScheduleMark(51, 0).reached(m));
    EXPECT_FALSE(ScheduleMark(50, 0).exceeded(m));
}

/// Counts densifications and notes the degree.
class Watched : public test::ForwardingEngine {
  public:
    Watched() : ForwardingEngine({"sh", 3, ColorActivation::kRelu}) {}
    void set_active_degree(int degree) override { degrees.push_back(degree); }
    DensifyStats densify(const DensifyRequest& request) override {
        if (std::holds_alternative<MortonOrder>(request.rule)) return {};
        at.push_back(request.iteration);
        cap = std::get<McmcParams>(request.rule).cap;
        return {};
    }
    std::vector<int> degrees;
    std::vector<std::int64_t> at;
    std::int64_t cap = 0;
};

Watched walk(const TrainOptions& o) {
    test::BackendOf<Watched> backend;
    backend.upload({});
    DensificationSchedule schedule(o, {"sh", 3, ColorActivation::kRelu}, 1, true, {});
    for (std::int64_t k = 0; k < o.iterations; ++k) schedule.before_step(backend, moment_at(o, k));
    return std::move(backend.engine());
}

TEST(Schedules, AShortRunIsComplete) {
    const Watched whole = walk(options_of(30000)), quarter = walk(options_of(7500));
    EXPECT_EQ(whole.at.size(), 244u);
    EXPECT_EQ(quarter.at.size(), 244u);
    EXPECT_EQ(quarter.at.front(), 150);
    EXPECT_EQ(quarter.at.back(), 24900 / 4);
    EXPECT_EQ(whole.degrees, quarter.degrees);
    EXPECT_EQ(quarter.degrees.back(), 3);
    const Watched fixed = walk(options_of(7500, ScheduleKind::kFixed));
    EXPECT_EQ(fixed.at.front(), 600);
    EXPECT_EQ(fixed.at.size(), 69u);
}

TEST(Schedules, DensificationsOfVeryShortRunsAreTenStepsApart) {
    const Watched few = walk(options_of(300));
    ASSERT_GT(few.at.size(), 10u);
    for (std::size_t k = 1; k < few.at.size(); ++k) EXPECT_GE(few.at[k] - few.at[k - 1], 10);
    EXPECT_EQ(few.degrees.back(), 3) << "several degrees in one step";
}

TEST(Schedules, NamedIterationsStay) {
    TrainOptions o = options_of(1000);
    o.densify_from_iter = 100, o.densify_until_iter = 400, o.densification_interval = 50;
    EXPECT_EQ(walk(o).at, (std::vector<std::int64_t>{100, 150, 200, 250, 300, 350, 400}));
}

TEST(Schedules, IntervalsCountFromTheFirstDensification) {
    TrainOptions o = options_of(30000);
    o.densification_interval = 250;
    EXPECT_EQ(walk(o).at.at(1), 850);
    o = options_of(30000);
    o.densify_from_iter = 550;
    EXPECT_EQ(walk(o).at.at(1), 650);
}

TEST(Schedules, RatesFallToTheirLastValueInARunOfAnyLength) {
    Scene scene;
    scene.train.resize(1);
    for (const std::int64_t iterations : {500, 30000}) {
        TrainOptions o = options_of(iterations);
        o.final_rate = 0.1, o.residual_rate = 3;
        const LearningRates rates(o, appearance_spec(o), scene);
        const StepRates first = rates.at(moment_at(o, 0)), last = rates.at(moment_at(o, iterations - 1));
        EXPECT_NEAR(last.groups[0] / first.groups[0], 0.01, 2e-4) << "means";
        for (int g = 1; g < int(Group::kSmoothing); ++g)
            EXPECT_NEAR(last.groups[g] / first.groups[g], 0.1, 1e-3) << kGroupNames[g];
        EXPECT_NEAR(first.groups[int(Group::kResidual)], 3 * 0.000125, 1e-12);
    }
}

TEST(Schedules, OpacitiesKeepTheirRateUntilMcmcHasEndedWhereResidualsGo) {
    Scene scene;
    scene.train.resize(1);
    const auto opacity_rate_at = [&](std::int64_t iteration, double share, Recipe recipe) {
        TrainOptions o = options_of(30000);
        o.final_rate = 0.1, o.appearance_share = share, o.recipe = recipe;
        return LearningRates(o, appearance_spec(o), scene).at(moment_at(o, iteration)).groups[int(Group::kOpacity)];
    };
    for (const auto& [share, recipe] : {std::pair{1.0, Recipe::kPaper}, {0.5, Recipe::kFrontier}})
        EXPECT_LT(opacity_rate_at(25000, share, recipe), 0.7 * opacity_rate_at(0, share, recipe));
    EXPECT_EQ(opacity_rate_at(25999, 0.5, Recipe::kPaper), opacity_rate_at(0, 0.5, Recipe::kPaper));
    EXPECT_NEAR(opacity_rate_at(29999, 0.5, Recipe::kPaper), 0.1 * opacity_rate_at(0, 0.5, Recipe::kPaper), 1e-5);
}

TEST(Schedules, ShortRunsHaveHigherRatesIfAsked) {
    Scene scene;
    scene.train.resize(1);
    const auto first_step = [&](std::int64_t iterations, double exponent, double travel) {
        TrainOptions o = options_of(iterations);
        o.short_rates = exponent, o.base_travel = travel;
        return LearningRates(o, appearance_spec(o), scene).at(moment_at(o, 0));
    };
    const StepRates plain = first_step(1000, 0, 0), higher = first_step(1000, 0.5, 0),
                    longer = first_step(10000, 0.5, 0);
    for (int g = 0; g < int(Group::kSmoothing); ++g) {
        // The means' rate falls with the position of the step's end, which is the same.
        EXPECT_NEAR(higher.groups[g] / plain.groups[g], std::sqrt(10.0), 1e-6) << kGroupNames[g];
        EXPECT_NEAR(longer.groups[g] / first_step(10000, 0, 0).groups[g], 1, 1e-12) << kGroupNames[g];
    }
    EXPECT_EQ(first_step(1, 0.5, 3.5).groups[int(Group::kScale)], first_step(50, 0.5, 3.5).groups[int(Group::kScale)])
        << "rates of 100 iterations are the highest";
    EXPECT_NEAR(higher.noise, plain.noise, 1e-6 * plain.noise) << "noise stays";
    EXPECT_NEAR(first_step(1000, 0, 3.5).groups[int(Group::kBase)], 3.5e-3, 1e-9);
    EXPECT_EQ(first_step(30000, 0, 3.5).groups[int(Group::kBase)], first_step(30000, 0, 0).groups[int(Group::kBase)]);
}

TEST(Schedules, FarMeansAreThoseBeyondTheExtentOfTheCameras) {
    Scene scene;
    scene.train.resize(2);
    scene.train[1].camera.translation = {-4, 0, 2};
    scene.extent = 2.5;
    TrainOptions o = options_of(1000);
    o.far_rate = 0.5;
    const StepRates rates = LearningRates(o, appearance_spec(o), scene).at(moment_at(o, 0));
    const Vec3<float> off = rates.center - Vec3<float>{2, 0, -1};
    EXPECT_EQ(dot(off, off), 0);
    EXPECT_EQ(rates.extent, 2.5f);
    EXPECT_EQ(rates.far, 0.5f);
}

double fake_time = 0;
double fake_clock() { return fake_time; }

TEST(TimeBudget, KeepsBackWhatSavingTakes) {
    TimeBudget budget(10, 0, 1000, fake_clock);
    fake_time = 100;
    budget.start({.saving_per_gaussian = 1e-6});
    EXPECT_NEAR(budget.for_steps(1000000), 9 - 0.02, 1e-9);
    fake_time = 104;
    EXPECT_NEAR(budget.elapsed(), 4, 1e-9);
    EXPECT_NEAR(budget.progress(1000000), 4 / 8.98, 1e-9);
    budget.leave_out(1);
    EXPECT_NEAR(budget.elapsed(), 3, 1e-9);
    budget.keep_back(2);
    EXPECT_NEAR(budget.for_steps(0), 7.98, 1e-9);
    EXPECT_EQ(budget.progress(100000000), 1) << "nothing is left";
}

TEST(TimeBudget, ContinuesWithWhatIsLeft) {
    TimeBudget budget(10, 6, 1000, fake_clock);
    budget.start({});
    EXPECT_NEAR(budget.elapsed(), 6, 1e-9);
    EXPECT_NEAR(budget.progress(0), 6 / 9.98, 1e-9);
}

TEST(TimeBudget, AffordsWhatLeavesEnoughSteps) {
    fake_time = 0;
    TimeBudget budget(100.02, 0, 1000, fake_clock);
    budget.start({.coarse_ratio = 4});
    EXPECT_EQ(budget.affordable(5000, 2, false), 5000) << "too few steps to tell";
    fake_time = 1;  // ten steps of 0.1 s: all 1000 just fit
    EXPECT_NEAR(double(budget.affordable(5000, 10, false)), 5000, 1);
    fake_time = 1.5;  // ten of 0.05 s
    EXPECT_NEAR(double(budget.affordable(5000, 20, false)), 10000, 1);
    fake_time = 2;  // the same, but full images take four times as long
    EXPECT_NEAR(double(budget.affordable(5000, 30, true)), 2500, 1);
}

TrainOptions limited(const std::string& limit) {
    TrainOptions o;
    o.source = "builtin:diffuse";
    o.time_limit = parse_duration(limit, "");
    o = resolve(o);
    return o;
}

TEST(TrainingSchedule, RunsThroughIterations) {
    TrainOptions o = options_of(3);
    o.coarse_until = 0.5;
    TrainingSchedule schedule(o, 10);
    std::vector<int> reductions;
    for (; !schedule.finished(); schedule.advance(100)) reductions.push_back(schedule.reduction());
    EXPECT_EQ(reductions, (std::vector<int>{2, 2, 1}));
    EXPECT_EQ(schedule.moment().iteration, 3);
    EXPECT_EQ(schedule.expected_iterations(), 3);
    EXPECT_FALSE(schedule.seconds_left());
    EXPECT_EQ(schedule.most_gaussians(7, 50), 50);
}

TEST(TrainingSchedule, RunsThroughTime) {
    const TrainOptions o = limited("0.4s");
    TrainingSchedule schedule(o, 10);
    EXPECT_EQ(schedule.seconds_left(), 0.4);
    schedule.start({}, 100);
    const double start = seconds_now();
    double position = -1, left = 0.4;
    while (!schedule.finished()) {
        EXPECT_EQ(schedule.expected_iterations(), 0) << "nobody knows";
        EXPECT_LE(schedule.seconds_left(), left);
        left = *schedule.seconds_left();
        EXPECT_GE(schedule.moment().position, position);
        position = schedule.moment().position;
        schedule.advance(100);
    }
    const double seconds = seconds_now() - start;
    EXPECT_GT(seconds, 0.3);
    EXPECT_LT(left, 0.1);
    EXPECT_GT(schedule.moment().iteration, 100);
    EXPECT_EQ(schedule.expected_iterations(), schedule.moment().iteration);
    const double pace = kReferenceIterations / double(schedule.moment().iteration);
    EXPECT_GT(schedule.moment().pace, pace / 3);
    EXPECT_LT(schedule.moment().pace, pace * 3);
}

TEST(TrainingSchedule, TimeBeforeTheFirstStepIsNoProgress) {
    const TrainOptions o = limited("10s");
    TrainingSchedule schedule(o, 10);
    schedule.charge(5);
    schedule.start({}, 100);
    EXPECT_LT(schedule.moment().position, 0.1 * kReferenceIterations);
    EXPECT_GE(schedule.used_seconds(), 5);
    EXPECT_NEAR(schedule.budget()->limit(), 5, 1e-9);
}

TEST(TrainingSchedule, StretchesGoFromTheirPositionToTheEnd) {
    TrainOptions o = options_of(30000);
    o.target_psnr = 30, o.coarse_until = 0.2;
    TrainingSchedule schedule(o, 10);
    schedule.begin({.steps = 4, .from = 0, .most_gaussians = 500}, 100);
    EXPECT_EQ(schedule.reduction(), 2);
    EXPECT_EQ(schedule.most_gaussians(100, 1000), 500);
    EXPECT_EQ(schedule.most_gaussians(600, 1000), 600) << "nothing is removed";
    EXPECT_EQ(schedule.most_gaussians(100, 300), 300);
    while (!schedule.finished()) schedule.advance(100);
    EXPECT_EQ(schedule.moment().iteration, 4);
    schedule.begin({.steps = 2, .from = 20000, .most_gaussians = 50}, 100);
    EXPECT_FALSE(schedule.finished());
    EXPECT_EQ(schedule.moment().position, 20000);
    EXPECT_EQ(schedule.moment().stride(), 5000);
    EXPECT_EQ(schedule.reduction(), 1);
    EXPECT_EQ(schedule.expected_iterations(), 6);
    schedule.advance(100);
    EXPECT_EQ(schedule.moment().position, 25000);
    schedule.advance(100);
    EXPECT_TRUE(schedule.finished());
    EXPECT_EQ(schedule.moment().iteration, 6);
}

TEST(TrainingSchedule, ATimeLimitShortensAStretch) {
    TrainOptions o = limited("0.3s");
    o.target_psnr = 30;
    TrainingSchedule schedule(o, 10);
    schedule.start({}, 100);
    schedule.begin({.steps = 1000000000, .from = 10000, .most_gaussians = 100}, 100);
    while (!schedule.finished()) schedule.advance(100);
    EXPECT_LT(schedule.moment().iteration, 1000000000);
    EXPECT_EQ(schedule.moment().position, kReferenceIterations) << "rates have fallen all the same";
    schedule.begin({.steps = 10, .from = 10000, .most_gaussians = 100}, 100);
    EXPECT_TRUE(schedule.finished()) << "no time is left";
}

TEST(TrainingSchedule, ALimitThatSavingUsesUpIsRefusedWithTheShortest) {
    const TrainOptions o = limited("1s");
    TrainingSchedule schedule(o, 10);
    try {
        schedule.start({.saving_per_gaussian = 2e-3}, 1000);
        FAIL();
    } catch (const UsageError& e) {
        EXPECT_NE(std::string(e.what()).find("1s is too short"), std::string::npos) << e.what();
        EXPECT_NE(std::string(e.what()).find("the shortest limit is 2.15s"), std::string::npos) << e.what();
    }
}

TEST(TrainingSchedule, AResumedRunThatHasUsedItsTimeIsFinished) {
    const TrainOptions o = limited("5s");
    TrainingSchedule schedule(o, 10);
    schedule.resume(1000, 5);
    schedule.start({}, 100);
    EXPECT_TRUE(schedule.finished());
    EXPECT_EQ(schedule.moment().iteration, 1000);
}

// The schedule of a training on a disk that is full for a while, on one that stays full, and of a run that ends twice.

TEST(TrainLog, LinesOfAFullDiskComeLater) {
    const TempFolder folder;
    const std::filesystem::path path = folder / "stats/train.jsonl";
    const int status = in_child([&] {
        TrainLog log(path, 0, false);
        limit_file_size(30);
        for (int i = 1; i <= 5; ++i) log.write({{"iteration", i}});
        if (slurp(path).size() != 30) return 1;
        limit_file_size(1 << 20);
        log.write({{"iteration", 6}});
        log.close();
        return 0;
    });
    EXPECT_EQ(status, 0);
    std::string expected;
    for (int i = 1; i <= 6; ++i) expected += "{\"iteration\":" + std::to_string(i) + "}\n";
    EXPECT_EQ(slurp(path), expected);
}

TEST(TrainLog, LinesThatAreMissingInTheEndAreADataError) {
    const TempFolder folder;
    const int status = in_child([&] {
        TrainLog log(folder / "train.jsonl", 0, false);
        limit_file_size(30);
        for (int i = 1; i <= 5; ++i) log.write({{"iteration", i}});
        return data_error_status([&] { log.close(); }, "train.jsonl", "File too large");
    });
    EXPECT_EQ(status, 0);
}

TEST(TrainLog, FinalLinesAreWrittenAnewByARunThatOnlyEndsOnceMore) {
    const TempFolder folder;
    const std::filesystem::path path = folder / "train.jsonl";
    const std::string steps = "{\"iteration\":100}\n{\"iteration\":200}\n",
                      end = "{\"final\":true,\"iteration\":200}\n";
    for (const bool at_end : {true, false}) {
        spit(path, steps + end);
        TrainLog(path, 200, at_end).close();
        EXPECT_EQ(slurp(path), at_end ? steps : steps + end);
        spit(path, "{\"final\":true,\"iteration\":100}\n" + steps + end + "{\"iteration\":201}\n");
        TrainLog(path, 200, at_end).close();
        EXPECT_EQ(slurp(path), "{\"final\":true,\"iteration\":100}\n" + steps + (at_end ? "" : end));
    }
}

TrainOptions options_of(Strategy strategy, std::int64_t iterations) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.strategy = strategy, o.iterations = iterations;
    o = resolve(o);
    return o;
}

TEST(TimeEstimate, WithoutGrowthEveryIterationTakesAsLong) {
    const TrainOptions o = options_of(Strategy::kNone, 30000);
    EXPECT_NEAR(estimate_seconds(o, o, {10, 0.5, 1000, 1e6}, 1000000), 0.5 * 29990, 1e-6);
    EXPECT_EQ(estimate_seconds(o, o, {30000, 0.5, 1000, 1e6}, 1000000), 0);
}

TEST(TimeEstimate, GrowthMakesIterationsLonger) {
    const TrainOptions o = options_of(Strategy::kMcmc, 30000);
    const double still = 30000, grown = estimate_seconds(o, o, {0, 1, 100000, 0}, 1000000);
    // Ten times as many after 100 log(10) / log(1.05) = 4,700 iterations from 600 on; pixels dampen that.
    EXPECT_GT(grown, 8 * still);
    EXPECT_LT(grown, 10 * still);
    EXPECT_NEAR(estimate_seconds(o, o, {0, 1, 100000, 1e9}, 1000000), still, 0.01 * still);
    EXPECT_NEAR(estimate_seconds(o, o, {0, 1, 100000, 0}, 1000), still, 1e-6)
        << "an initial model above the cap is kept";
}

TEST(TimeEstimate, CoarseStepsAreNoMeasureOfFullImages) {
    TrainOptions o = options_of(Strategy::kNone, 1000);
    o.coarse_until = 0.2;
    EXPECT_NEAR(estimate_seconds(o, o, {0, 1, 1, 1e9}, 1), 200 + 4 * 800, 5);
}

TEST(TimeEstimate, AVeryLongRunIsEstimatedAtOnce) {
    const TrainOptions o = options_of(Strategy::kMcmc, 2147483647);
    const double seconds = estimate_seconds(o, o, {0, 1, 1000000, 0}, 1000000);
    EXPECT_NEAR(seconds, 2147483647.0, 1);
}

}  // namespace
}  // namespace gs::test
