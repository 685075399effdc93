// SPDX-License-Identifier: Apache-2.0
// Makes the initial points, and the first Gaussians from their neighbourhood.
#include "lib/model/initialize.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nanoflann.hpp>
#include <optional>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/base/rng.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/seen.h"

namespace gs {
namespace {

/// The squared distance below which neighbours count as duplicates. It keeps the logarithm of the scale finite.
constexpr double kMinSquaredDistance = 1e-7;

/// Presents the points to nanoflann.
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

/// Keeps `most` points at even distances in the list, or all if `most` is 0.
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

/// Returns the unit mean of the directions from the cameras to a point; empty where they point all ways alike.
std::optional<Vec3<double>> mean_direction(const Eigen::Vector3d& point, const std::vector<Eigen::Vector3d>& cameras) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& camera : cameras) sum += (point - camera).normalized();
    const double length = sum.norm();
    if (!(length > 0.01 * double(cameras.size()))) return std::nullopt;
    return Vec3<double>{sum.x() / length, sum.y() / length, sum.z() / length};
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
    // One more than 3, because the nearest point is the point itself, or another at the same place with the same
    // distance.
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
        // A single point has no neighbour to tell its size and gets a hundredth of the scene.
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

}  // namespace gs
