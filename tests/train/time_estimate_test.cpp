// SPDX-License-Identifier: Apache-2.0
#include "lib/train/run_costs.h"

#include <gtest/gtest.h>

#include "lib/core/options.h"

namespace gs {
namespace {

TrainOptions options_of(Strategy strategy, std::int64_t iterations) {
    TrainOptions o;
    o.source = "builtin:diffuse", o.strategy = strategy, o.iterations = iterations;
    validate(o);
    return o;
}

TEST(TimeEstimate, WithoutGrowthEveryIterationTakesAsLong) {
    const TrainOptions o = options_of(Strategy::kNone, 30000);
    EXPECT_NEAR(estimate_seconds(o, {10, 0.5, 1000, 1e6}, 1000000), 0.5 * 29990, 1e-6);
    EXPECT_EQ(estimate_seconds(o, {30000, 0.5, 1000, 1e6}, 1000000), 0);
}

TEST(TimeEstimate, GrowthMakesIterationsLonger) {
    const TrainOptions o = options_of(Strategy::kMcmc, 30000);
    const double still = 30000, grown = estimate_seconds(o, {0, 1, 100000, 0}, 1000000);
    // Ten times as many after 100 log(10) / log(1.05) = 4,700 iterations from 600 on; pixels dampen that.
    EXPECT_GT(grown, 8 * still);
    EXPECT_LT(grown, 10 * still);
    EXPECT_NEAR(estimate_seconds(o, {0, 1, 100000, 1e9}, 1000000), still, 0.01 * still);
    EXPECT_NEAR(estimate_seconds(o, {0, 1, 100000, 0}, 1000), still, 1e-6) << "an initial model above the cap is kept";
}

TEST(TimeEstimate, CoarseStepsAreNoMeasureOfFullImages) {
    TrainOptions o = options_of(Strategy::kNone, 1000);
    o.coarse_until = 0.2;
    EXPECT_NEAR(estimate_seconds(o, {0, 1, 1, 1e9}, 1), 200 + 4 * 800, 5);
}

TEST(TimeEstimate, AVeryLongRunIsEstimatedAtOnce) {
    const TrainOptions o = options_of(Strategy::kMcmc, 2147483647);
    const double seconds = estimate_seconds(o, {0, 1, 1000000, 0}, 1000000);
    EXPECT_NEAR(seconds, 2147483647.0, 1);
}

}  // namespace
}  // namespace gs
