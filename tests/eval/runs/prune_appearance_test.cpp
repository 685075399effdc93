// SPDX-License-Identifier: Apache-2.0
#include "eval/runs/prune_appearance.h"

#include <gtest/gtest.h>

#include "appearance/model_info.h"
#include "kernels/core/error.h"
#include "lib/model/appearance_spec.h"

namespace gs {
namespace {

/// Returns a camera at the origin that looks at +z.
CameraParams<float> camera() {
    CameraParams<float> c{};
    c.rotation = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    c.fx = c.fy = 40, c.cx = 20, c.cy = 15;
    c.width = 40, c.height = 30;
    return c;
}

/// Returns a camera at the origin that looks at -z.
CameraParams<float> camera_behind() {
    CameraParams<float> c = camera();
    c.rotation = {{-1, 0, 0}, {0, 1, 0}, {0, 0, -1}};
    return c;
}

/// Returns grey, half opaque Gaussians at `means` with the model's initial residuals.
Gaussians gaussians(const std::string& model, const std::vector<Vec3<float>>& means) {
    const ModelInfo& info = appearance_model(model);
    Gaussians g;
    g.count = std::int64_t(means.size());
    g.appearance = {model, info.default_max_degree, ColorActivation::kRelu};
    g.active_degree = g.appearance.max_degree;
    for (int k = 0; k < kNumGroups; ++k) {
        g.groups[k].width = group_width(Group(k), g.appearance);
        g.groups[k].param.resize(means.size() * std::size_t(g.groups[k].width));
    }
    for (std::size_t i = 0; i < means.size(); ++i) {
        const Vec3<float> m = means[i];
        std::copy_n(std::begin({m.x, m.y, m.z}), 3, &g[Group::kMean].param[3 * i]);
        std::fill_n(&g[Group::kScale].param[3 * i], 3, -2.0f);
        g[Group::kRotation].param[4 * i] = 1;
        info.init_residual(g.appearance.max_degree,
                           g[Group::kResidual].param.data() + i * std::size_t(g[Group::kResidual].width));
    }
    g.shared.width = info.num_shared;
    g.shared.param.resize(std::size_t(info.num_shared));
    if (info.num_shared > 0) info.init_shared(0, g.shared.param.data());
    return g;
}

using Marks = std::vector<std::uint8_t>;

TEST(PruneAppearance, MarksTheResidualsThatShow) {
    Gaussians g = gaussians("sh", {{0, 0, 3}, {0.2f, 0, 3}});
    std::vector<float>& residual = g[Group::kResidual].param;
    residual[3 + 1] = 0.1f;         // green of the band along z: 0.049 towards the camera
    residual[45 + 3 + 1] = 0.002f;  // 0.001 is less than half a step
    EXPECT_EQ(shown_residuals(g, {camera()}), (Marks{1, 0}));
    residual[45 + 3 + 1] = 0.1f;
    EXPECT_EQ(shown_residuals(g, {camera()}), (Marks{1, 1}));
    residual.resize(45);
    EXPECT_EQ(shown_residuals(g, {camera()}), (Marks{1, 0})) << "the second has none";
}

TEST(PruneAppearance, OnlyViewsThatDrawAGaussianCount) {
    Gaussians g = gaussians("sh", {{0, 0, 3}, {0, 0, -3}});
    g[Group::kResidual].param[3] = g[Group::kResidual].param[45 + 3] = 0.1f;
    EXPECT_EQ(shown_residuals(g, {camera()}), (Marks{1, 0}));
    EXPECT_EQ(shown_residuals(g, {camera(), camera_behind()}), (Marks{1, 1}));
    EXPECT_EQ(shown_residuals(g, {}), (Marks{0, 0}));
}

TEST(PruneAppearance, AColourThatCannotChangeShowsNoResidual) {
    Gaussians g = gaussians("sh", {{0, 0, 3}});
    std::fill_n(g[Group::kBase].param.begin(), 3, -2.0f);
    g[Group::kResidual].param[3] = 1;
    EXPECT_EQ(shown_residuals(g, {camera()}), (Marks{0})) << "black with and without";
}

TEST(PruneAppearance, EveryModelCanBePruned) {
    for (const ModelInfo* info : appearance_models()) {
        const Gaussians g = gaussians(info->name, {{0, 0, 3}, {0, 0, -3}});
        if (g[Group::kResidual].width == 0)
            EXPECT_THROW(shown_residuals(g, {camera()}), UsageError) << info->name;
        else
            EXPECT_EQ(shown_residuals(g, {camera()})[1], 0) << info->name;
    }
}

}  // namespace
}  // namespace gs
