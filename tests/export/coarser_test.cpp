// SPDX-License-Identifier: Apache-2.0
// What is merged, what stays as it is, and what is left out.
#include "lib/export/coarser.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "kernels/base/portable.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

float logit(double opacity) { return float(std::log(opacity / (1 - opacity))); }

/// Balls of standard deviation 0.1 and one colour.
Gaussians balls(const std::vector<std::array<float, 3>>& means, double opacity) {
    Gaussians g;
    g.appearance = {"none", 0, ColorActivation::kRelu};
    for (int k = 0; k < kNumGroups; ++k) g.groups[k].width = group_width(Group(k), g.appearance);
    const auto add = [&](Group group, std::initializer_list<float> values) {
        g[group].param.insert(g[group].param.end(), values);
    };
    for (const auto& mean : means) {
        ++g.count;
        add(Group::kMean, {mean[0], mean[1], mean[2]});
        add(Group::kScale, {std::log(0.1f), std::log(0.1f), std::log(0.1f)});
        add(Group::kRotation, {1, 0, 0, 0});
        add(Group::kOpacity, {logit(opacity)});
        add(Group::kBase, {0.1f, 0.2f, 0.3f});
    }
    return g;
}

TEST(Coarser, MergedGaussiansHaveTheMomentsOfTheirParts) {
    // Along x, at 0 with weight 3 and at 0.4 with weight 1: the mean is 0.1, the variance 0.01 + 0.75*0.25*0.16 = 0.04.
    Gaussians g = balls({{0, 0, 0}, {0.4f, 0, 0}, {50, 0, 0}}, 0.2);
    g[Group::kBase].param[3] = 0.5f;
    const auto [out, scores] = coarser_model(g, {3, 1, 4}, 2);
    EXPECT_EQ(scores, (std::vector<float>{4, 4}));
    ASSERT_EQ(out.count, 2);
    EXPECT_NEAR(out[Group::kMean].param[0], 0.1, 1e-6);
    EXPECT_NEAR(out[Group::kMean].param[1], 0, 1e-6);
    EXPECT_NEAR(out[Group::kBase].param[0], 0.2, 1e-6);
    std::array<float, 3> scales;
    std::copy_n(out[Group::kScale].param.begin(), 3, scales.begin());
    std::sort(scales.begin(), scales.end());
    EXPECT_NEAR(std::exp(scales[0]), 0.1, 1e-5);
    EXPECT_NEAR(std::exp(scales[1]), 0.1, 1e-5);
    EXPECT_NEAR(std::exp(scales[2]), 0.2, 1e-5);
    // Twice the opacity times area of a ball, over the area of the ellipsoid, whose axes are 0.1, 0.1, 0.2.
    const double p = 1.6, ball = 0.01, area = std::pow((std::pow(ball, p) + 2 * std::pow(2 * ball, p)) / 3, 1 / p);
    EXPECT_NEAR(sigmoid(double(out[Group::kOpacity].param[0])), 2 * 0.2 * ball / area, 1e-5);
    // The one far away has no part: not a bit of it changes.
    for (int k = 0; k < kNumGroups; ++k) {
        for (int c = 0; c < g.groups[k].width; ++c)
            EXPECT_EQ(out.groups[k].param[std::size_t(g.groups[k].width + c)],
                      g.groups[k].param[std::size_t(2 * g.groups[k].width + c)]);
    }
}

TEST(Coarser, TheMostSimilarNeighbourTakesIt) {
    // The last is nearer to the first and has the colour of the second.
    Gaussians g = balls({{0, 0, 0}, {0.3f, 0, 0}, {0.12f, 0, 0}}, 0.5);
    g[Group::kBase].param[0] = 0.9f;
    const Gaussians out = coarser_model(g, {10, 10, 5}, 2).gaussians;
    EXPECT_EQ(out[Group::kMean].param[0], 0);
    EXPECT_LT(out[Group::kMean].param[3], 0.3f);
}

TEST(Coarser, WhatHardlyShowsIsLeftOut) {
    const Gaussians g = balls({{0, 0, 0}, {0.1f, 0, 0}, {0.2f, 0, 0}}, 0.5);
    const Gaussians out = coarser_model(g, {1000, 0.05f, 0}, 1).gaussians;
    ASSERT_EQ(out.count, 1);
    EXPECT_EQ(out[Group::kMean].param, (std::vector<float>{0, 0, 0}));
    EXPECT_EQ(out[Group::kOpacity].param[0], g[Group::kOpacity].param[0]);
}

TEST(Coarser, ResidualsStayWithTheirGaussians) {
    Gaussians g = random_gaussians(200, {"sh", 1, ColorActivation::kRelu}, true);
    const int width = g[Group::kResidual].width;
    g[Group::kResidual].param.resize(std::size_t(80 * width));  // mixed
    std::vector<float> scores(200);
    for (std::size_t i = 0; i < scores.size(); ++i) scores[i] = float(i % 2);
    const Gaussians out = coarser_model(g, scores, 100).gaussians;
    ASSERT_EQ(out.count, 100);
    ASSERT_EQ(out.num_residuals(), 40);
    for (int k = 0; k < 40; ++k) {
        for (int c = 0; c < width; ++c)
            ASSERT_EQ(out[Group::kResidual].param[std::size_t(k * width + c)],
                      g[Group::kResidual].param[std::size_t((2 * k + 1) * width + c)]);
    }
    EXPECT_TRUE(out[Group::kMean].m.empty());
}

TEST(Coarser, AllOfItIsTheModel) {
    const Gaussians g = random_gaussians(30, {"none", 0, ColorActivation::kRelu});
    const Gaussians out = coarser_model(g, std::vector<float>(30, 1), 30).gaussians;
    for (int k = 0; k < kNumGroups; ++k) EXPECT_EQ(out.groups[k].param, g.groups[k].param);
}

TEST(Coarser, ExtremesStayFinite) {
    // All at one place, flat, of equal and of no score, one infinite, one as large as scales can be.
    Gaussians g = balls(std::vector<std::array<float, 3>>(40, {1, 2, 3}), 0.999999);
    for (std::size_t i = 0; i < 40; ++i) g[Group::kScale].param[3 * i] = i == 39 ? 50 : -60;
    std::vector<float> scores(40, 0);
    scores[0] = std::numeric_limits<float>::infinity();
    scores[1] = scores[2] = 2;
    for (const std::int64_t count : {1, 2, 20}) {
        const Gaussians out = coarser_model(g, scores, count).gaussians;
        EXPECT_EQ(out.count, count);
        for (const auto& group : out.groups) {
            for (const float x : group.param) ASSERT_TRUE(std::isfinite(x));
        }
    }
}

}  // namespace
}  // namespace gs::test
