// SPDX-License-Identifier: Apache-2.0
// Colours Gaussians by their residuals.
#include "eval/runs/appearance_colors.h"

#include <algorithm>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/parallel.h"
#include "kernels/preprocess/gaussian_device.h"

namespace gs {
namespace {

constexpr std::size_t kMostViews = 32;
/// As in apps/viewer/src/render/prepass.frag.glsl.
constexpr double kNoResidual[3] = {0.25, 0.25, 0.25}, kLeastChange[3] = {0.1, 0.3, 0.9}, kMostChange[3] = {1, 0.8, 0.1};
constexpr double kChangeScale = 4;

}  // namespace

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
