// SPDX-License-Identifier: Apache-2.0
// Reads a model and gives it another appearance.
#include "lib/model/start_from.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/log.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/bring_into_frame.h"
#include "lib/model/initialize.h"
#include "lib/model/limit_values.h"
#include "lib/model/model_file.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns the .ply file that `from` names.
fs::path file_of(const fs::path& from) {
    std::error_code ignored;
    if (fs::is_directory(from, ignored)) {
        require_model_file(from);
        return RunFolder{from}.point_cloud(latest_point_cloud(from));
    }
    if (from.extension() == ".ply" || fs::exists(from, ignored)) return from;
    throw UsageError(fmt::format("option init: '{}' is neither a .ply file nor a run folder", from.string()));
}

/// Returns the frame whose coordinates lie in `from` as those of `to` lie in the scene's.
Frame between(const Frame& from, const Frame& to) {
    return {.center = from.from_scene(to.center), .scale = to.scale / from.scale};
}

bool has_same_model(const AppearanceSpec& a, const AppearanceSpec& b) {
    return a.model == b.model && a.max_degree == b.max_degree && a.activation == b.activation;
}

bool are_both_plain_sh(const AppearanceSpec& a, const AppearanceSpec& b) {
    return appearance_model(a.model).plain_sh && appearance_model(b.model).plain_sh && a.activation == b.activation;
}

/// Returns rows of `width` numbers that begin as the given ones; what is new is 0.
std::vector<float> with_width(const GroupArrays<float>& rows, std::int64_t count, int width) {
    std::vector<float> out(std::size_t(count) * std::size_t(width));
    const int shared = std::min(width, rows.width);
    for (std::int64_t i = 0; i < count; ++i)
        std::copy_n(rows.param.begin() + i * rows.width, shared, out.begin() + i * width);
    return out;
}

/// Puts the colours that cameras see on average in the place of base and residual.
void flatten(Gaussians& g, const Scene& scene, ColorActivation activation) {
    const ModelInfo& model = appearance_model(g.appearance.model);
    const std::vector<Eigen::Vector3d> cameras = sampled_cameras(scene);
    const std::vector<double> shared(g.shared.param.begin(), g.shared.param.end());
    const int width = g[Group::kResidual].width;
    parallel_for_rows(g.count, [&](std::int64_t i) {
        float* base = &g[Group::kBase].param[3 * std::size_t(i)];
        const Vec3<double> y{base[0], base[1], base[2]};
        Vec3<double> mean = activate(g.appearance.activation, y);
        if (i < g.num_residuals() && !cameras.empty()) {
            const float* row = g[Group::kResidual].param.data() + i * width;
            const std::vector<double> params(row, row + width);
            const Eigen::Vector3d at = Eigen::Vector3f::Map(&g[Group::kMean].param[3 * std::size_t(i)]).cast<double>();
            mean = {0, 0, 0};
            for (const Eigen::Vector3d& camera : cameras) {
                const Eigen::Vector3d d = (at - camera).stableNormalized();
                const Vec3<double> r =
                    model.residual(shared.data(), params.data(), {d.x(), d.y(), d.z()}, g.appearance.max_degree);
                mean += activate(g.appearance.activation, y + r) * (1.0 / double(cameras.size()));
            }
        }
        base[0] = float(inverse_color_activation(activation, mean.x));
        base[1] = float(inverse_color_activation(activation, mean.y));
        base[2] = float(inverse_color_activation(activation, mean.z));
    });
}

/// Gives every Gaussian the residual of a model that shows nothing and can be learnt from there.
void clear_residuals(Gaussians& g, const Scene& scene, std::uint64_t seed) {
    const ModelInfo& model = appearance_model(g.appearance.model);
    g[Group::kResidual] = {};
    g[Group::kResidual].width = group_width(Group::kResidual, g.appearance);
    g[Group::kResidual].param.resize(std::size_t(g.count) * std::size_t(g[Group::kResidual].width));
    initialize_residuals(scene, g);
    if (model.clear_residual)
        parallel_for_rows(g.count, [&](std::int64_t i) {
            model.clear_residual(g.appearance.max_degree,
                                 g[Group::kResidual].param.data() + i * g[Group::kResidual].width);
        });
    g.shared = {};
    g.shared.width = model.num_shared;
    g.shared.param.resize(std::size_t(model.num_shared));
    if (model.num_shared > 0) model.init_shared(seed, g.shared.param.data());
}

}  // namespace

InitialModel read_initial_model(const fs::path& from) {
    InitialModel model{file_of(from), {}};
    model.gaussians = read_ply(model.file, &model.frame);
    if (model.gaussians.count == 0) throw DataError(fmt::format("{}: no Gaussians to begin with", model.file.string()));
    return model;
}

Gaussians start_from(InitialModel model, const Scene& scene, const AppearanceSpec& appearance, std::uint64_t seed) {
    Gaussians g = std::move(model.gaussians);
    bring_into_frame(g, between(model.frame.value_or(Frame{}), scene.frame));
    if (const std::int64_t changed = make_trainable(g); changed > 0)
        log_info("{}: infinite opacities or scales of {} Gaussians have no gradient and begin as large finite ones",
                 model.file.string(), changed);
    const AppearanceSpec before = g.appearance;
    const int width = group_width(Group::kResidual, appearance);
    std::string residuals = "residuals begin at 0";
    if (has_same_model(before, appearance)) {
        g.active_degree = appearance.max_degree;
        residuals = "with their residuals";
    } else if (are_both_plain_sh(before, appearance)) {
        const std::int64_t rows = g.num_residuals();
        g[Group::kResidual].param = with_width(g[Group::kResidual], rows, width);
        g[Group::kResidual].width = width;
        g.appearance = appearance;
        g.active_degree = appearance.max_degree;
        residuals =
            fmt::format("with spherical harmonics of degree {} as {}", before.max_degree, appearance.max_degree);
        if (rows == 0 && width > 0) clear_residuals(g, scene, seed);
    } else {
        flatten(g, scene, appearance.activation);
        g.appearance = appearance;
        g.active_degree = std::min(appearance_model(appearance.model).initial_degree, appearance.max_degree);
        clear_residuals(g, scene, seed);
    }
    log_info("begins with the {} Gaussians of {} ({}), {}", g.count, model.file.string(), before.model, residuals);
    return g;
}

}  // namespace gs
