// SPDX-License-Identifier: Apache-2.0
#include "kernels/backends/instance_forecast.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace gs {
namespace {

constexpr std::int64_t kUnknown = std::numeric_limits<std::int64_t>::max();

TEST(InstanceForecast, KnowsNothingOfANewView) {
    InstanceForecast f;
    EXPECT_EQ(f.most(3), kUnknown);
    f.note(3, 1'000'000);
    EXPECT_GE(f.most(3), 1'000'000);
    EXPECT_LT(f.most(3), 1'500'000);
    EXPECT_EQ(f.most(4), kUnknown);
    f.note(-1, 1'000'000);
    EXPECT_EQ(f.most(-1), kUnknown);
}

// 40 views that differ by up to four times, while all grow by a thousandth a step.
TEST(InstanceForecast, FollowsATrainingThatGrows) {
    InstanceForecast f;
    double level = 500'000;
    int known = 0;
    for (int step = 0; step < 2000; ++step, level *= 1.001) {
        const int view = step * 7 % 40;
        const auto n = std::int64_t(level * (1 + 3 * view / 39.0));
        if (step >= 40) {
            const std::int64_t most = f.most(view);
            EXPECT_GE(most, n) << step;
            EXPECT_LE(most, n * 1.5 + 20'000) << step;
            ++known;
        }
        f.note(view, n);
    }
    EXPECT_EQ(known, 1960);
}

// Opacities are reset: views have a third of their instances, and soon as many as before.
TEST(InstanceForecast, FollowsAResetWithFewSteps) {
    InstanceForecast f;
    int too_many = 0;
    for (int step = 0; step < 3000; ++step) {
        const int view = step * 7 % 40, since = step % 1000;
        const double level = step < 1000 ? 1e6 : 1e6 * (1 - 0.7 * std::exp(-since / 100.0));
        const auto n = std::int64_t(level * (1 + view / 39.0));
        if (n > f.most(view)) ++too_many;
        f.note(view, n);
    }
    EXPECT_LE(too_many, 30);
}

// One view fills up, and disturbs no other.
TEST(InstanceForecast, OneViewThatChangesDoesNotMoveTheOthers) {
    InstanceForecast f;
    for (int view = 0; view < 40; ++view) f.note(view, view == 0 ? 0 : 1'000'000);
    for (int step = 0; step < 400; ++step) {
        const int view = step * 7 % 40;
        if (view) {
            EXPECT_GE(f.most(view), 1'000'000) << step;
            EXPECT_LE(f.most(view), 2'000'000) << step;
        }
        f.note(view, 1'000'000);
    }
    EXPECT_GE(f.most(0), 1'000'000);
    EXPECT_LE(f.most(0), 2'000'000);
}

TEST(InstanceForecast, TakesViewsWithoutInstances) {
    InstanceForecast f;
    for (int k = 0; k < 100; ++k) f.note(k % 2, k % 2 ? 1'000'000 : 0);
    EXPECT_GE(f.most(0), 0);
    EXPECT_GE(f.most(1), 1'000'000);
}

}  // namespace
}  // namespace gs
