// SPDX-License-Identifier: Apache-2.0
// The nearest known name.
#include "lib/core/nearest.h"

#include <gtest/gtest.h>

namespace gs {
namespace {

TEST(Nearest, SmallestEditDistanceWins) {
    const std::vector<std::string> keys = {"iterations", "sh-degree", "cap-max", "opacity-lr"};
    EXPECT_EQ(nearest_key("iteration", keys), "iterations");
    EXPECT_EQ(nearest_key("itreations", keys), "iterations");
    EXPECT_EQ(nearest_key("SH_DEGREE", keys), "sh-degree");
    EXPECT_EQ(nearest_key("capmx", keys), "cap-max");
    EXPECT_EQ(nearest_key("ab", {"aa", "bb"}), "aa") << "the first of equally near ones";
    EXPECT_EQ(nearest_key("acb", {"abcd", "abc"}), "abc") << "a swap of neighbours costs one";
    EXPECT_EQ(nearest_key("x", {}), "");
}

TEST(Nearest, WhatIsFarIsNoSuggestion) {
    EXPECT_EQ(nearest_key("--feature-lr", {"--test-every", "--far-rate"}), "");
    EXPECT_EQ(nearest_key("--antialias", {"--axes", "--images"}), "");
    EXPECT_EQ(did_you_mean("--frobnicate", {"--format", "--device"}), "");
    EXPECT_EQ(did_you_mean("--frmat", {"--format", "--device"}), "; did you mean '--format'?");
}

}  // namespace
}  // namespace gs
