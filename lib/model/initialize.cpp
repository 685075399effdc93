// SPDX-License-Identifier: Apache-2.0
// Makes the initial points and Gaussians sized by their neighbourhood, or reads a model and converts it to another
// appearance.
#include "lib/model/initialize.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nanoflann.hpp>
#include <system_error>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/base/rng.h"
#include "lib/core/log.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/model_file.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "lib/model/whole_model.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

/// The squared distance below which neighbours count as duplicates. This bound keeps the logarithm of the scale finite.
constexpr double kMinSquaredDistance = 1e-7;

/// The interface of the points for nanoflann.
struct PointAdaptor {
    const std::vector<Eigen::Vector3f>& points;
    std::size_t kdtree_get_point_count() const { return points.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t axis) const { return points[i][Eigen::Index(axis)]; }
    template <class Box> bool kdtree_get_bbox(Box&) const { return false; }
};
using KdTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, PointAdaptor>, PointAdaptor, 3>;

PointCloud random_points(const Scene& scene, const InitOptions& options) {
    Eigen::Vector3d center = scene.random_init_center;
    double half = scene.random_init_half_extent;
    if (half <= 0) {
        center.setZero();
        for (const View& view : scene.train) center += view.camera.center();
        if (!scene.train.empty()) center /= double(scene.train.size());
        half = 3 * scene.extent;
    }
    std::vector<Eigen::Vector3f> drawn(std::size_t(options.random_points));
    std::vector<char> kept(drawn.size());
    parallel_for_rows(options.random_points, [&](std::int64_t i) {
        const Philox4 r = philox(options.seed, RngStream::kInitPoints, std::uint64_t(i), 0);
        Eigen::Vector3d p;
        for (int k = 0; k < 3; ++k) p[k] = center[k] + half * (2 * uniform_from_bits<double>(r.v[k]) - 1);
        drawn[std::size_t(i)] = p.cast<float>();
        kept[std::size_t(i)] = std::any_of(scene.train.begin(), scene.train.end(),
                                           [&](const View& v) { return seen(v.camera, p) == Seen::kDrawn; });
    });
    PointCloud cloud;
    for (std::size_t i = 0; i < drawn.size(); ++i) {
        if (kept[i]) cloud.positions.push_back(drawn[i]);
    }
    cloud.colors.assign(cloud.positions.size(), Eigen::Vector3f::Constant(0.5f));
    if (cloud.positions.empty()) {
        const Eigen::Vector3d shown = scene.frame.to_scene(center);
        throw DataError(fmt::format(
            "scene '{}': none of {} random points within {} of ({}, {}, {}) is seen by a training view; "
            "check the camera poses",
            scene.source, options.random_points, half / scene.frame.scale, shown.x(), shown.y(), shown.z()));
    }
    return cloud;
}

/// Keeps `most` points, evenly spaced in the list, or all points if `most` is 0.
PointCloud sample(PointCloud cloud, std::int64_t most) {
    const auto all = std::int64_t(cloud.positions.size());
    if (most <= 0 || all <= most) return cloud;
    for (std::int64_t k = 0; k < most; ++k) {
        cloud.positions[k] = cloud.positions[k * all / most];
        cloud.colors[k] = cloud.colors[k * all / most];
    }
    cloud.positions.resize(most), cloud.colors.resize(most);
    return cloud;
}

/// Returns the normalised mean of the directions from the cameras to a point; nothing if the directions cancel out.
std::optional<Vec3<double>> mean_direction(const Eigen::Vector3d& point, const std::vector<Eigen::Vector3d>& cameras) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& camera : cameras) sum += (point - camera).normalized();
    const double length = sum.norm();
    if (!(length > 0.01 * double(cameras.size()))) return std::nullopt;
    return Vec3<double>{sum.x() / length, sum.y() / length, sum.z() / length};
}

namespace fs = std::filesystem;

/// Returns the .ply file of `from`, which is a file or a run folder.
fs::path file_of(const fs::path& from) {
    std::error_code ignored;
    if (fs::is_directory(from, ignored)) {
        require_model_file(from);
        return RunFolder{from}.point_cloud(latest_point_cloud(from));
    }
    if (from.extension() == ".ply" || fs::exists(from, ignored)) return from;
    throw UsageError(fmt::format("option init: '{}' is neither a .ply file nor a run folder", from.string()));
}

/// Returns the frame that maps coordinates of `from` to coordinates of `to`, as `to` does for scene coordinates.
Frame between(const Frame& from, const Frame& to) {
    return {.center = from.from_scene(to.center), .scale = to.scale / from.scale};
}

bool has_same_model(const AppearanceSpec& a, const AppearanceSpec& b) {
    return a.model == b.model && a.max_degree == b.max_degree && a.activation == b.activation;
}

bool are_both_plain_sh(const AppearanceSpec& a, const AppearanceSpec& b) {
    return appearance_model(a.model).plain_sh && appearance_model(b.model).plain_sh && a.activation == b.activation;
}

/// Returns the rows truncated or padded with zeros to `width` numbers.
std::vector<float> with_width(const GroupArrays<float>& rows, std::int64_t count, int width) {
    std::vector<float> out(std::size_t(count) * std::size_t(width));
    const int shared = std::min(width, rows.width);
    for (std::int64_t i = 0; i < count; ++i)
        std::copy_n(rows.param.begin() + i * rows.width, shared, out.begin() + i * width);
    return out;
}

/// Replaces base and residual by the mean colours that the cameras see, stored in the base.
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

/// Sets every Gaussian's residual to a value without effect from which it can be trained.
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

std::vector<Eigen::Vector3d> sampled_cameras(const Scene& scene) {
    constexpr std::size_t kMost = 32;
    const std::size_t count = std::min(kMost, scene.train.size());
    std::vector<Eigen::Vector3d> centers;
    for (std::size_t k = 0; k < count; ++k)
        centers.push_back(scene.train[k * scene.train.size() / count].camera.center());
    return centers;
}

std::vector<double> mean_squared_neighbor_distances(const std::vector<Eigen::Vector3f>& points) {
    std::vector<double> means(points.size(), 0.0);
    if (points.size() < 2) return means;
    const PointAdaptor adaptor{points};
    const KdTree tree(3, adaptor, nanoflann::KDTreeSingleIndexAdaptorParams(16));
    // One more than 3, because the nearest point is the point itself, or another at the same position with distance 0.
    const std::size_t wanted = std::min<std::size_t>(4, points.size());
    parallel_for_rows(std::int64_t(points.size()), [&](std::int64_t i) {
        const Eigen::Vector3d query = points[std::size_t(i)].cast<double>();
        std::array<std::uint32_t, 4> index;
        std::array<double, 4> squared{};
        tree.knnSearch(query.data(), wanted, index.data(), squared.data());
        means[std::size_t(i)] = (squared[1] + squared[2] + squared[3]) / double(wanted - 1);
    });
    return means;
}

InitOptions init_options(const TrainOptions& options) {
    return {.mcmc = options.strategy == Strategy::kMcmc, .random_points = options.init_points, .seed = options.seed};
}

PointCloud initial_points(const Scene& scene, const InitOptions& options) {
    if (scene.points.positions.empty()) return sample(random_points(scene, options), options.most_points);
    PointCloud cloud;
    for (std::size_t i = 0; i < scene.points.positions.size(); ++i) {
        if (!scene.points.positions[i].allFinite()) continue;
        cloud.positions.push_back(scene.points.positions[i]);
        cloud.colors.push_back(scene.points.colors[i]);
    }
    if (cloud.positions.empty())
        throw DataError(
            fmt::format("scene '{}': none of its {} points is finite", scene.source, scene.points.positions.size()));
    return sample(std::move(cloud), options.most_points);
}

void initialize_residuals(const Scene& scene, Gaussians& g) {
    const ModelInfo& model = appearance_model(g.appearance.model);
    const std::vector<Eigen::Vector3d> cameras = sampled_cameras(scene);
    GroupArrays<float>& residuals = g[Group::kResidual];
    parallel_for_rows(g.count, [&](std::int64_t i) {
        float* row = residuals.param.data() + i * residuals.width;
        model.init_residual(g.appearance.max_degree, row);
        if (!model.aim_residual) return;
        const Eigen::Vector3d mean = Eigen::Vector3f::Map(&g[Group::kMean].param[std::size_t(3 * i)]).cast<double>();
        if (const auto direction = mean_direction(mean, cameras))
            model.aim_residual(g.appearance.max_degree, *direction, row);
    });
}

Gaussians initialize_gaussians(const Scene& scene, const AppearanceSpec& appearance, const InitOptions& options) {
    const PointCloud cloud = initial_points(scene, options);
    const std::vector<double> squared = mean_squared_neighbor_distances(cloud.positions);
    const ModelInfo& model = appearance_model(appearance.model);

    Gaussians g;
    g.count = std::int64_t(cloud.positions.size());
    g.appearance = appearance;
    g.active_degree = std::min(model.initial_degree, appearance.max_degree);
    for (int i = 0; i < kNumGroups; ++i) {
        g.groups[i].width = group_width(Group(i), appearance);
        g.groups[i].param.assign(std::size_t(g.count) * g.groups[i].width, 0.0f);
    }
    const float opacity = options.mcmc ? 0.5f : 0.1f;
    const double factor = options.mcmc ? 0.1 : 1.0;
    for (std::int64_t i = 0; i < g.count; ++i) {
        const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
        std::copy_n(cloud.positions[std::size_t(i)].data(), 3, row(Group::kMean));
        // A single point has no neighbours to determine its scale, which becomes a hundredth of the scene extent.
        const double scale = g.count > 1 ? factor * std::sqrt(std::max(squared[std::size_t(i)], kMinSquaredDistance))
                                         : 0.01 * scene.extent;
        std::fill_n(row(Group::kScale), 3, float(std::log(scale)));
        row(Group::kRotation)[0] = 1;
        row(Group::kOpacity)[0] = std::log(opacity / (1 - opacity));
        for (int c = 0; c < 3; ++c) {
            row(Group::kBase)[c] = inverse_color_activation(appearance.activation, cloud.colors[std::size_t(i)][c]);
        }
    }
    initialize_residuals(scene, g);
    g.shared.width = model.num_shared;
    g.shared.param.resize(std::size_t(model.num_shared));
    if (model.num_shared > 0) model.init_shared(options.seed, g.shared.param.data());
    return g;
}

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
