// SPDX-License-Identifier: Apache-2.0
// Which Gaussians a hostile start changes, and how.
#include "tests/model/hostile_start.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "appearance/model_info.h"

namespace gs::test {
namespace {

Gaussians ordinary(std::int64_t count) {
    Gaussians g;
    g.count = count;
    g.appearance = {"nasg", 1, ColorActivation::kRelu};
    const int widths[kNumGroups] = {3, 3, 4, 1, 3, 8};
    for (int k = 0; k < kNumGroups; ++k)
        g.groups[k].width = widths[k], g.groups[k].param.assign(std::size_t(count) * widths[k], 0.25f);
    return g;
}

bool changed(const Gaussians& g, Group group, std::int64_t i) {
    const auto& values = g[group];
    bool all = true, none = true;
    for (int k = 0; k < values.width; ++k)
        (values.param[std::size_t(i) * values.width + k] == 0.25f ? all : none) = false;
    EXPECT_NE(all, none) << "the whole row or nothing of it";
    return all;
}

TEST(HostileStart, ChangesItsShareAndAllButTheMean) {
    Gaussians g = ordinary(4000);
    const std::int64_t count = make_hostile(g, 0.1, 3);
    EXPECT_NEAR(double(count), 400, 80) << "four standard deviations";
    std::int64_t found = 0;
    for (std::int64_t i = 0; i < g.count; ++i) {
        EXPECT_FALSE(changed(g, Group::kMean, i));
        const bool base = changed(g, Group::kBase, i);
        for (const Group group : {Group::kScale, Group::kRotation, Group::kOpacity, Group::kResidual})
            EXPECT_EQ(changed(g, group, i), base) << i;
        found += base;
    }
    EXPECT_EQ(found, count);
}

TEST(HostileStart, DrawsEveryExtremeAndNothingElse) {
    Gaussians g = ordinary(500);
    EXPECT_EQ(make_hostile(g, 1, 0), 500);
    const auto magnitudes = [&](Group group) {
        std::set<float> found;
        for (const float x : g[group].param) found.insert(std::abs(x));
        return found;
    };
    EXPECT_EQ(magnitudes(Group::kScale), (std::set<float>{2, 30}));
    EXPECT_EQ(magnitudes(Group::kRotation), (std::set<float>{1e-20f, 1e-3f, 1e3f, 1e20f}));
    EXPECT_EQ(magnitudes(Group::kOpacity), (std::set<float>{50}));
    EXPECT_EQ(magnitudes(Group::kBase), (std::set<float>{3, 1e4f}));
    EXPECT_EQ(magnitudes(Group::kResidual), (std::set<float>{1e-6f, 1e4f, 1e30f}));
}

TEST(HostileStart, DependsOnTheSeedAndTheRowAlone) {
    Gaussians a = ordinary(100), b = ordinary(300), c = ordinary(100), none = ordinary(100);
    make_hostile(a, 0.5, 1), make_hostile(b, 0.5, 1), make_hostile(c, 0.5, 2);
    EXPECT_EQ(make_hostile(none, 0, 1), 0);
    b[Group::kScale].param.resize(a[Group::kScale].param.size());
    EXPECT_EQ(a[Group::kScale].param, b[Group::kScale].param);
    EXPECT_NE(a[Group::kScale].param, c[Group::kScale].param);
    EXPECT_EQ(none[Group::kScale].param, ordinary(100)[Group::kScale].param);
}

}  // namespace
}  // namespace gs::test
