// SPDX-License-Identifier: Apache-2.0
// Finds the range of depths and maps them to colours, and colours Gaussians by their residuals.
#include "apps/gsapp/render/false_colors.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/parallel.h"
#include "kernels/preprocess/gaussian_device.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

/// Colour map viridis (matplotlib, CC0), sampled at nine even steps; colours between them are interpolated.
constexpr int kSteps = 8;
constexpr double kViridis[kSteps + 1][3] = {{68, 1, 84},    {71, 45, 123},  {59, 82, 139},
                                            {44, 114, 142}, {33, 144, 140}, {39, 173, 129},
                                            {93, 200, 99},  {170, 220, 50}, {253, 231, 37}};

/// Share of the pixels at either end that does not extend the range.
constexpr double kOutside = 0.01;
constexpr float kLeastAlpha = 0.5f;

constexpr std::size_t kMostViews = 32;
/// Colours as in apps/viewer/src/render/prepass.frag.glsl.
constexpr double kNoResidual[3] = {0.25, 0.25, 0.25}, kLeastChange[3] = {0.1, 0.3, 0.9}, kMostChange[3] = {1, 0.8, 0.1};
constexpr double kChangeScale = 4;

}  // namespace

void DepthRangeFinder::add(const std::vector<float>& depth, const std::vector<float>& alpha) {
    std::vector<float> covered;
    covered.reserve(depth.size());
    for (std::size_t i = 0; i < depth.size(); ++i)
        if (alpha[i] >= kLeastAlpha && depth[i] > 0) covered.push_back(depth[i]);
    if (covered.empty()) return;
    const auto skipped = std::ptrdiff_t(kOutside * double(covered.size()));
    std::nth_element(covered.begin(), covered.begin() + skipped, covered.end());
    const double near = covered[std::size_t(skipped)];
    std::nth_element(covered.begin(), covered.end() - 1 - skipped, covered.end());
    const double far = *(covered.end() - 1 - skipped);
    range_ = found_ ? DepthRange{std::min(range_.near, near), std::max(range_.far, far)} : DepthRange{near, far};
    found_ = true;
}

Image colored_depth(const std::vector<float>& depth, int width, int height, const DepthRange& range) {
    Image image{width, height, 3, std::vector<std::uint8_t>(3 * depth.size()), {}};
    const double span = std::max(range.far - range.near, 1e-30);
    for (std::size_t i = 0; i < depth.size(); ++i) {
        if (!(depth[i] > 0)) continue;
        const double at = kSteps * std::clamp((range.far - depth[i]) / span, 0.0, 1.0);
        const int step = std::min(int(at), kSteps - 1);
        for (std::size_t c = 0; c < 3; ++c)
            image.u8[3 * i + c] =
                std::uint8_t(std::lround(std::lerp(kViridis[step][c], kViridis[step + 1][c], at - step)));
    }
    return image;
}

std::string depth_range_text(const DepthRange& range, DepthKind kind) {
    const nlohmann::ordered_json json = {
        {"near", range.near},
        {"far", range.far},
        {"units", "scene units along the camera's forward axis"},
        {"values", kind == DepthKind::kMedian
                       ? "median depth, of the Gaussian at which transmittance falls to 1/2 or below; 0 where it stays "
                         "above"
                       : "expected depth, sum(w z) / sum(w); 0 where nothing is seen"},
        {"colors", "viridis: yellow at near, purple at far, linear in depth; black where it is 0"}};
    return json_text(json, 2) + "\n";
}

Gaussians appearance_colors(const Gaussians& model, const std::vector<View>& views) {
    const ModelInfo& info = appearance_model(model.appearance.model);
    const ColorActivation activation = model.appearance.activation;
    const std::vector<double> shared(model.shared.param.begin(), model.shared.param.end());
    std::vector<Vec3<double>> positions;
    const std::size_t sampled = std::min(views.size(), kMostViews);
    for (std::size_t k = 0; k < sampled; ++k) {
        const Eigen::Vector3d p = views[k * views.size() / sampled].camera.center();
        positions.push_back({p.x(), p.y(), p.z()});
    }
    Gaussians out = model;
    out.ppisp = {};
    auto& residuals = out[Group::kResidual];
    residuals.param.clear(), residuals.m.clear(), residuals.v.clear();
    parallel_for_rows(model.count, [&](std::int64_t i) {
        float* base = out[Group::kBase].param.data() + 3 * i;
        const float* mean = model[Group::kMean].param.data() + 3 * i;
        const Vec3<double> y{base[0], base[1], base[2]};
        double color[3] = {kNoResidual[0], kNoResidual[1], kNoResidual[2]};
        if (i < model.num_residuals() && info.residual) {
            const int width = model[Group::kResidual].width;
            const auto first = model[Group::kResidual].param.begin() + i * width;
            const std::vector<double> params(first, first + width);
            double change = 0;
            for (const Vec3<double>& position : positions) {
                const Vec3<double> direction = view_direction<double>({mean[0], mean[1], mean[2]}, position).unit;
                const Vec3<double> residual =
                    info.residual(shared.data(), params.data(), direction, model.active_degree);
                const Vec3<double> d = gaussian_color(activation, y, residual, RenderMode::kResidualOnly);
                change += (d.x + d.y + d.z) / 3;
            }
            const double t = std::min(1.0, kChangeScale * change / double(std::max<std::size_t>(1, positions.size())));
            for (int c = 0; c < 3; ++c) color[c] = kLeastChange[c] + t * (kMostChange[c] - kLeastChange[c]);
        }
        for (int c = 0; c < 3; ++c) base[c] = float(inverse_color_activation(activation, color[c]));
    });
    return out;
}

}  // namespace gs
