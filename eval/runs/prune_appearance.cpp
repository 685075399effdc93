// SPDX-License-Identifier: Apache-2.0
// Finds the Gaussians whose colour no camera sees change, and clears their parameters.
#include "eval/runs/prune_appearance.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>

#include "appearance/contract.h"
#include "appearance/model_info.h"
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

template <class Model> std::int64_t prune(Gaussians& g, const Cameras& cameras) {
    const ModelInfo& info = appearance_model(g.appearance.model);
    const int width = g[Group::kResidual].width;
    if (width == 0)
        throw UsageError(
            fmt::format("appearance {}: Gaussians have no view-dependent parameters that could be pruned", info.name));
    if constexpr (kNumSharedOf<Model> != 0) {
        throw UsageError(
            fmt::format("appearance {}: view dependence comes from a network that all of them share, and no parameters "
                        "of one Gaussian make it zero",
                        info.name));
    } else {
        std::vector<float> zero(static_cast<std::size_t>(width));
        info.init_residual(g.appearance.max_degree, zero.data());
        if (info.clear_residual) info.clear_residual(g.appearance.max_degree, zero.data());
        const ParameterView<float> params = ParameterView<float>::of(g);
        std::atomic<std::int64_t> pruned = 0;
        parallel_for_rows(g.count, [&](std::int64_t i) {
            if (shows_residual<Model>(params, i, g.active_degree, cameras, kHalfStep)) return;
            std::copy(zero.begin(), zero.end(), g[Group::kResidual].param.begin() + i * width);
            if (shows_residual<Model>(params, i, g.active_degree, cameras, 0))
                throw UsageError(fmt::format(
                    "appearance {}: the model names no parameters of a Gaussian that make its view dependence zero",
                    info.name));
            ++pruned;
        });
        return pruned;
    }
}

template <class... Models> std::int64_t prune_named(Gaussians& g, const Cameras& cameras) {
    std::int64_t pruned = 0;
    const auto try_model = [&]<class Model>(const Model* model) {
        if (g.appearance.model == appearance_name(model)) pruned = prune<Model>(g, cameras);
    };
    (try_model(static_cast<const Models*>(nullptr)), ...);
    return pruned;
}

}  // namespace

std::int64_t prune_residuals(Gaussians& gaussians, const std::vector<CameraParams<float>>& cameras) {
    return prune_named<GS_ALL_APPEARANCE_MODELS>(gaussians, cameras);
}

}  // namespace gs
