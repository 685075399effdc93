// SPDX-License-Identifier: Apache-2.0
#include "kernels/backends/instance_forecast.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

/// Adds a whole window of n, with `once` in the middle, and returns what comes at its end.
std::int64_t add_window(RecentMost& recent, std::int64_t n, std::int64_t once = 0) {
    std::optional<std::int64_t> most;
    for (int k = 0; k < RecentMost::kWindow; ++k) {
        EXPECT_FALSE(most) << "only at the end of a window";
        most = recent.add(k == RecentMost::kWindow / 2 ? std::max(n, once) : n);
    }
    EXPECT_TRUE(most);
    return most.value_or(-1);
}

TEST(RecentMost, ForgetsAfterTwoWindows) {
    RecentMost recent;
    EXPECT_EQ(add_window(recent, 10), 10);
    EXPECT_EQ(add_window(recent, 5, 1000), 1000);
    EXPECT_EQ(add_window(recent, 5), 1000);
    EXPECT_EQ(add_window(recent, 5), 5);
    EXPECT_EQ(add_window(recent, 0), 5);
    EXPECT_EQ(add_window(recent, 0), 0);
}

}  // namespace
}  // namespace gs
