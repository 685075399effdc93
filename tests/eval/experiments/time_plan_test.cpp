// SPDX-License-Identifier: Apache-2.0
#include "eval/experiments/tradeoff_search.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

TrainOptions run(std::int64_t iterations, std::int64_t cap_max, const std::string& appearance = "sh") {
    TrainOptions o;
    o.iterations = iterations, o.cap_max = cap_max, o.appearance = appearance;
    return o;
}

TEST(TimePlan, TriesWhatNothingIsKnownOf) {
    const TimePlan plan;
    EXPECT_FALSE(plan.seconds(run(1000, 1000)));
    EXPECT_TRUE(plan.fits(run(1000, 1000), 0.1));
}

TEST(TimePlan, ScalesTheNearestRunAndAddsWhatALaunchTakes) {
    TimePlan plan;
    plan.add(run(1000, 1000), 10, 12);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(1000, 1000)), 12);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 1000)), 42);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 10000)), 402);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(500, 1000)), 7);
    plan.add(run(4000, 10000), 90, 93);  // measured: far less than in proportion
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 10000)), 93);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(4000, 20000)), 183);
    EXPECT_TRUE(plan.fits(run(4000, 20000), 183));
    EXPECT_FALSE(plan.fits(run(4000, 20000), 182));
}

TEST(TimePlan, KnowsTheTimeOfRunsWithALimit) {
    TimePlan plan;
    TrainOptions limited = run(1000, 1000);
    limited.time_limit = "20s";
    EXPECT_DOUBLE_EQ(*plan.seconds(limited), 20);
    plan.add(limited, 19, 25);
    EXPECT_DOUBLE_EQ(*plan.seconds(limited), 26);
    EXPECT_FALSE(plan.seconds(run(1000, 1000))) << "its length says nothing about a number of iterations";
}

TEST(TimePlan, PrefersTheAppearanceAmongRunsOfOneSize) {
    TimePlan plan;
    plan.add(run(1000, 1000, "none"), 5, std::nullopt);
    plan.add(run(1000, 1000, "sh"), 8, std::nullopt);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "none")), 10);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "sh")), 16);
    EXPECT_DOUBLE_EQ(*plan.seconds(run(2000, 1000, "nasg")), 10) << "of equals the first";
}

}  // namespace
}  // namespace gs
