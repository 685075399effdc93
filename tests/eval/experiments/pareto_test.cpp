// SPDX-License-Identifier: Apache-2.0
#include "eval/experiments/tradeoff.h"

#include <gtest/gtest.h>

#include <limits>

namespace gs {
namespace {

using Flags = std::vector<bool>;
using Indices = std::vector<std::size_t>;

TEST(Pareto, DominanceNeedsNoWorseInAllAndBetterInOne) {
    EXPECT_TRUE(dominates({1, 2, 3, 4}, {1, 2, 3, 5}));
    EXPECT_FALSE(dominates({1, 2, 3, 4}, {1, 2, 3, 4}));
    EXPECT_FALSE(dominates({0, 2, 3, 5}, {1, 2, 3, 4}));
    EXPECT_FALSE(dominates({1, 2, 3, 5}, {1, 2, 3, 4}));
}

TEST(Pareto, FrontHasWhatNobodyDominates) {
    EXPECT_EQ(pareto_front({}), Flags{});
    EXPECT_EQ(pareto_front({{-30, 9, 9, 9}}), Flags{true});
    // Best, cheapest, beaten by both neighbours, twice the same, worse than these.
    EXPECT_EQ(
        pareto_front({{-30, 9, 1, 1}, {-20, 1, 1, 1}, {-19, 9, 2, 2}, {-25, 4, 1, 1}, {-25, 4, 1, 1}, {-25, 5, 1, 1}}),
        (Flags{true, true, false, true, true, false}));
    const double inf = std::numeric_limits<double>::infinity();
    EXPECT_EQ(pareto_front({{-inf, 2, 1, 1}, {-40, 1, 1, 1}, {-40, 3, 1, 1}}), (Flags{true, true, false}))
        << "a perfect score";
}

TEST(Pareto, BetterHalfTakesWholeFrontsFirst) {
    EXPECT_EQ(better_half({}), Indices{});
    EXPECT_EQ(better_half({{0, 0, 0, 0}}), Indices{0});
    // 1 and 3 dominate 0, which dominates 2.
    EXPECT_EQ(better_half({{-20, 5, 1, 1}, {-22, 5, 1, 1}, {-19, 6, 1, 1}, {-20, 4, 1, 1}}), (Indices{1, 3}));
    EXPECT_EQ(better_half({{-20, 5, 1, 1}, {-22, 5, 1, 1}, {-19, 6, 1, 1}, {-20, 4, 1, 1}, {-18, 7, 1, 1}}),
              (Indices{0, 1, 3}));
}

TEST(Pareto, BetterHalfKeepsTheEndsOfAFrontThatDoesNotFit) {
    // All optimal; 1 and 2 lie close together, 3 far from its neighbours.
    EXPECT_EQ(better_half({{-20, 1, 1, 1}, {-20.1, 1.1, 1, 1}, {-20.2, 1.2, 1, 1}, {-25, 5, 1, 1}, {-30, 10, 1, 1}}),
              (Indices{0, 3, 4}));
    EXPECT_EQ(better_half({{1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}, {1, 1, 1, 1}}), (Indices{0, 1}))
        << "equal ones: the first";
}

}  // namespace
}  // namespace gs
