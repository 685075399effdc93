// SPDX-License-Identifier: Apache-2.0
// Finds the Gaussians whose colour a camera sees change.
#include "eval/runs/prune_appearance.h"

#include <fmt/format.h>

#include <algorithm>

#include "appearance/contract.h"
#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "kernels/preprocess/gaussian_device.h"

#include "appearance_types.inc"

namespace gs {
namespace {

using Cameras = std::vector<CameraParams<float>>;

constexpr float kHalfStep = 0.5f / 255;

/// Returns whether the residual changes the colour of Gaussian i by more than `limit` for a camera that draws it.
template <class Model>
bool shows_residual(const ParameterView<float>& params, std::int64_t i, int degree, const Cameras& cameras,
                    float limit) {
    const GaussianGeometry<float> geometry = params.geometry(i);
    return std::any_of(cameras.begin(), cameras.end(), [&](const CameraParams<float>& camera) {
        Splat<float> splat;
        PixelBounds bounds;
        float depth;
        if (!make_splat(geometry, camera, camera.width, camera.height, splat, bounds, depth)) return false;
        const Vec3<float> residual =
            model_residual<Model>(params.shared, params.residual(i), params.direction(i, camera.position).unit, degree);
        const Vec3<float> change =
            gaussian_color(params.activation, params.base(i), residual, RenderMode::kResidualOnly);
        return !(change.x <= limit && change.y <= limit && change.z <= limit);
    });
}

template <class Model> std::vector<std::uint8_t> find_shown(const Gaussians& g, const Cameras& cameras) {
    if (g[Group::kResidual].width == 0)
        throw UsageError(fmt::format("appearance {}: Gaussians have no view-dependent parameters that could be pruned",
                                     g.appearance.model));
    const ParameterView<float> params = ParameterView<float>::of(g);
    std::vector<std::uint8_t> shown(std::size_t(g.count), 0);
    parallel_for_rows(params.num_residuals, [&](std::int64_t i) {
        shown[std::size_t(i)] = shows_residual<Model>(params, i, g.active_degree, cameras, kHalfStep);
    });
    return shown;
}

template <class... Models> std::vector<std::uint8_t> find_shown_of_named(const Gaussians& g, const Cameras& cameras) {
    std::vector<std::uint8_t> shown;
    const auto try_model = [&]<class Model>(const Model* model) {
        if (g.appearance.model == appearance_name(model)) shown = find_shown<Model>(g, cameras);
    };
    (try_model(static_cast<const Models*>(nullptr)), ...);
    return shown;
}

}  // namespace

std::vector<std::uint8_t> shown_residuals(const Gaussians& gaussians, const std::vector<CameraParams<float>>& cameras) {
    return find_shown_of_named<GS_ALL_APPEARANCE_MODELS>(gaussians, cameras);
}

}  // namespace gs
