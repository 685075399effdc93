// SPDX-License-Identifier: Apache-2.0
// Makes models of fewer Gaussians by merging Gaussians into staying neighbours. Each level is made from the whole
// model.
#include "lib/export/coarser.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <nanoflann.hpp>
#include <numeric>

#include "kernels/base/parallel.h"
#include "kernels/splat/raster_config.h"
#include "lib/export/file_rows.h"
#include "lib/export/ngsplat.h"

namespace gs {
namespace {

/// Number of neighbours that are candidates for merging a Gaussian.
constexpr std::size_t kNeighbours = 8;
/// Weight of a squared colour difference relative to a squared distance in standard deviations.
constexpr double kColourWeight = 100;
/// The fraction of the total score that may be left out. Merging nearly invisible Gaussians would add opacity in empty
/// space.
constexpr double kLeftOut = 1e-4;
/// The least weight, above 0 so that Gaussians without a score can be merged.
constexpr double kLeastScore = 1e-30;
constexpr double kMostOpacity = 0.9999;
/// Constant added to variances, so that covariances of discs stay invertible.
constexpr double kLeastVariance = 1e-12;

/// The merged properties of one Gaussian.
struct Body {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero(), color = Eigen::Vector3d::Zero();
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    double cover = 0;   ///< opacity times mean area
    double weight = 0;  ///< score, clamped
};

Body body_of(const Gaussians& g, const std::vector<float>& scores, std::int64_t i) {
    const auto row = [&](Group group) { return g[group].param.data() + i * g[group].width; };
    const float *mean = row(Group::kMean), *scale = row(Group::kScale), *q = row(Group::kRotation),
                *color = row(Group::kBase);
    const auto size = [&](int k) { return std::exp(std::min(double(scale[k]), kMaxLogScale)); };
    const Eigen::Vector3d sizes(size(0), size(1), size(2));
    const Eigen::Matrix3d axes = Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
    Body body;
    body.mean = {mean[0], mean[1], mean[2]}, body.color = {color[0], color[1], color[2]};
    body.covariance = axes * sizes.cwiseAbs2().asDiagonal() * axes.transpose();
    body.cover = sigmoid(double(*row(Group::kOpacity))) * mean_area({sizes[0], sizes[1], sizes[2]});
    body.weight = std::clamp(double(scores[std::size_t(i)]), kLeastScore, 1e30);
    return body;
}

/// Returns the dissimilarity of two Gaussians.
double difference(const Body& a, const Body& b) {
    const Eigen::Vector3d d = a.mean - b.mean;
    Eigen::Matrix3d both = a.covariance + b.covariance;
    both.diagonal().array() += kLeastVariance;
    return d.dot(both.ldlt().solve(d)) + kColourWeight * (a.color - b.color).squaredNorm();
}

/// Adapter that gives nanoflann the means of the staying Gaussians.
struct StayingMeans {
    const std::vector<Body>& bodies;
    const std::vector<std::int64_t>& rows;
    std::size_t kdtree_get_point_count() const { return rows.size(); }
    double kdtree_get_pt(std::size_t i, std::size_t axis) const {
        return bodies[std::size_t(rows[i])].mean[Eigen::Index(axis)];
    }
    template <class Box> bool kdtree_get_bbox(Box&) const { return false; }
};
using MeansTree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, StayingMeans>, StayingMeans,
                                                      3, std::size_t>;

/// Returns for every row the position in `stay` of the Gaussian into which it is merged, or -1 if it is left out.
/// `order` has the rows by descending score; `stay` has the first of these rows in the order of the model.
std::vector<std::int64_t> find_targets(const std::vector<Body>& bodies, const std::vector<std::int64_t>& order,
                                       const std::vector<std::int64_t>& stay) {
    constexpr std::int64_t kOpen = -2;
    std::vector<std::int64_t> target(bodies.size(), kOpen);
    for (std::size_t k = 0; k < stay.size(); ++k) target[std::size_t(stay[k])] = std::int64_t(k);
    double total = 0, sum = 0;
    for (const Body& body : bodies) total += body.weight;
    for (std::size_t k = order.size(); k-- > stay.size();) {
        sum += bodies[std::size_t(order[k])].weight;
        if (sum > kLeftOut * total) break;
        target[std::size_t(order[k])] = -1;
    }
    const StayingMeans means{bodies, stay};
    const MeansTree tree(3, means, nanoflann::KDTreeSingleIndexAdaptorParams(16));
    parallel_for_rows(std::int64_t(bodies.size()), [&](std::int64_t i) {
        const Body& body = bodies[std::size_t(i)];
        if (target[std::size_t(i)] != kOpen) return;
        std::array<std::size_t, kNeighbours> near;
        std::array<double, kNeighbours> squared_distances;
        const std::size_t found = tree.knnSearch(body.mean.data(), kNeighbours, near.data(), squared_distances.data());
        const auto cost = [&](std::size_t k) { return difference(body, bodies[std::size_t(stay[k])]); };
        target[std::size_t(i)] = std::int64_t(*std::min_element(near.begin(), near.begin() + std::ptrdiff_t(found),
                                                                [&](auto a, auto b) { return cost(a) < cost(b); }));
    });
    return target;
}

/// Returns the merged properties, one per staying Gaussian.
std::vector<Body> merged(const std::vector<Body>& bodies, const std::vector<std::int64_t>& target, std::size_t count) {
    std::vector<Body> out(count);
    const auto each = [&](auto&& add) {
        for (std::size_t i = 0; i < bodies.size(); ++i) {
            if (target[i] >= 0) add(bodies[i], out[std::size_t(target[i])]);
        }
    };
    each([](const Body& part, Body& whole) { whole.weight += part.weight, whole.cover += part.cover; });
    each([](const Body& part, Body& whole) {
        whole.mean += part.weight / whole.weight * part.mean;
        whole.color += part.weight / whole.weight * part.color;
    });
    each([](const Body& part, Body& whole) {
        const Eigen::Vector3d d = part.mean - whole.mean;
        whole.covariance += part.weight / whole.weight * (part.covariance + d * d.transpose());
    });
    return out;
}

/// Writes a merged Gaussian, except its residual, to row k.
void store(const Body& body, Gaussians& g, std::int64_t k) {
    const auto row = [&](Group group) { return g[group].param.data() + k * g[group].width; };
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solved(body.covariance);
    Eigen::Matrix3d axes = solved.eigenvectors();
    if (axes.determinant() < 0) axes.col(0) *= -1;
    const Eigen::Quaterniond q(axes);
    const Eigen::Vector3d sizes = solved.eigenvalues().cwiseMax(kLeastVariance).cwiseSqrt();
    const double opacity = std::clamp(body.cover / mean_area({sizes[0], sizes[1], sizes[2]}), kMinAlpha, kMostOpacity);
    for (int a = 0; a < 3; ++a) {
        row(Group::kMean)[a] = float(body.mean[a]);
        row(Group::kScale)[a] = float(std::log(sizes[a]));
        row(Group::kBase)[a] = float(body.color[a]);
    }
    const std::array<double, 4> wxyz = {q.w(), q.x(), q.y(), q.z()};
    std::copy(wxyz.begin(), wxyz.end(), row(Group::kRotation));
    *row(Group::kOpacity) = float(std::log(opacity / (1 - opacity)));
}

}  // namespace

CoarserModel coarser_model(const Gaussians& g, const std::vector<float>& scores, std::int64_t count) {
    std::vector<std::int64_t> order(std::size_t(g.count));
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::int64_t a, std::int64_t b) { return scores[std::size_t(a)] > scores[std::size_t(b)]; });
    std::vector<std::int64_t> stay(order.begin(), order.begin() + count);
    std::sort(stay.begin(), stay.end());
    std::vector<Body> bodies(std::size_t(g.count));
    parallel_for_rows(g.count, [&](std::int64_t i) { bodies[std::size_t(i)] = body_of(g, scores, i); });
    const std::vector<std::int64_t> target = find_targets(bodies, order, stay);
    const std::vector<Body> whole = merged(bodies, target, stay.size());
    std::vector<char> has_part(stay.size());
    for (std::size_t i = 0; i < target.size(); ++i) {
        if (target[i] >= 0 && stay[std::size_t(target[i])] != std::int64_t(i)) has_part[std::size_t(target[i])] = 1;
    }
    CoarserModel out{selected_rows(g, stay), std::vector<float>(stay.size())};
    parallel_for_rows(count, [&](std::int64_t k) {
        if (has_part[std::size_t(k)]) store(whole[std::size_t(k)], out.gaussians, k);
        out.scores[std::size_t(k)] = float(whole[std::size_t(k)].weight);
    });
    return out;
}

std::vector<std::int64_t> level_counts(std::int64_t count) {
    std::vector<std::int64_t> counts;
    for (count /= 2; counts.size() < std::size_t(kMostLevels) && count >= ngsplat_unit(); count /= 2)
        counts.push_back(count);
    return counts;
}

std::vector<CoarserModel> coarser_levels(const Gaussians& model, const std::vector<float>& scores) {
    std::vector<CoarserModel> levels;
    for (const std::int64_t count : level_counts(model.count)) levels.push_back(coarser_model(model, scores, count));
    return levels;
}

}  // namespace gs
