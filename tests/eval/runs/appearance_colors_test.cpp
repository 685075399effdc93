// SPDX-License-Identifier: Apache-2.0
// The colours that show who has a residual.
#include "apps/gsapp/render/false_colors.h"

#include <gtest/gtest.h>

#include "tests/eval/support/tiny_run.h"

namespace gs {
namespace {

std::vector<float> color_of(const Gaussians& g) {
    return appearance_colors(g, std::vector<View>(1))[Group::kBase].param;
}

TEST(AppearanceColors, GoFromGreyThroughBlueToYellow) {
    Gaussians g = test::one_sh_gaussian(0.0f);
    g.active_degree = 1;
    const std::vector<float> grey = {-0.25f, -0.25f, -0.25f}, blue = {-0.4f, -0.2f, 0.4f};
    const auto expect_near = [](const std::vector<float>& a, const std::vector<float>& b) {
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(a[std::size_t(c)], b[std::size_t(c)], 1e-6) << c;
    };
    expect_near(color_of(g), blue);
    for (float& x : g[Group::kResidual].param) x = 5;
    const std::vector<float> much = color_of(g);
    EXPECT_GT(much[0], much[2]) << "yellow";
    g[Group::kResidual].param.clear();
    expect_near(color_of(g), grey);
    EXPECT_EQ(appearance_colors(g, {})[Group::kMean].param, g[Group::kMean].param);
    EXPECT_EQ(appearance_colors(Gaussians{}, {}).count, 0);
}

}  // namespace
}  // namespace gs
