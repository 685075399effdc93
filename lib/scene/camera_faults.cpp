// SPDX-License-Identifier: Apache-2.0
// Finds camera poses that cannot be right.
#include "lib/scene/camera_faults.h"

#include <fmt/format.h>

#include <algorithm>

#include "lib/core/median.h"

namespace gs {
namespace {

/// Poses that contradict the evidence are errors if they are few. Otherwise the evidence is.
bool are_few(std::size_t wrong, std::size_t all) {
    constexpr double kMost = 0.1;
    return double(wrong) <= std::max(1.0, kMost * double(all));
}

/// Returns the distances of the cameras from their middle in units of the median distance; 0 if they are in one place.
std::vector<double> distances_from_middle(const std::vector<Eigen::Vector3d>& centers) {
    if (centers.empty()) return {};
    Eigen::Vector3d middle;
    for (int axis = 0; axis < 3; ++axis) {
        std::vector<double> values;
        for (const Eigen::Vector3d& center : centers) values.push_back(center[axis]);
        middle[axis] = median(std::move(values));
    }
    std::vector<double> distances;
    for (const Eigen::Vector3d& center : centers) distances.push_back((center - middle).stableNorm());
    const double usual = median(distances);
    for (double& distance : distances) distance = usual > 0 ? distance / usual : 0;
    return distances;
}

/// Returns for each view whether its pose contradicts the points that its image sees, whose errors are given. COLMAP
/// keeps points that are off by up to 4 pixels, and the median of an image is about a pixel.
std::vector<bool> contradict_tracks(const std::vector<std::optional<double>>& errors_of_views) {
    constexpr double kLargest = 0.02, kLargestOfUsual = 6;
    std::vector<bool> wrong(errors_of_views.size());
    std::vector<double> errors;
    for (const std::optional<double>& error : errors_of_views)
        if (error) errors.push_back(*error);
    if (errors.empty()) return wrong;
    const double largest = std::max(kLargest, kLargestOfUsual * median(errors));
    for (std::size_t i = 0; i < wrong.size(); ++i) wrong[i] = errors_of_views[i] && *errors_of_views[i] > largest;
    if (!are_few(std::size_t(std::count(wrong.begin(), wrong.end(), true)), errors.size()))
        wrong.assign(wrong.size(), false);
    return wrong;
}

bool sees_a_point(const SourceView& view, const SourcePoints& points) {
    return std::any_of(points.positions.begin(), points.positions.end(), [&](const Eigen::Vector3d& point) {
        const auto at = project(view.lens, view.rotation * point + view.translation);
        return at && at->x() >= 0 && at->y() >= 0 && at->x() <= view.lens.width && at->y() <= view.lens.height;
    });
}

}  // namespace

std::optional<double> track_error(const SourceView& view) {
    constexpr std::size_t kFewest = 10;
    if (view.observations.size() < kFewest) return {};
    const Eigen::Vector2d size(view.lens.width, view.lens.height);
    std::vector<double> errors;
    for (const PointObservation& seen : view.observations) {
        const auto at = project(view.lens, view.rotation * seen.point + view.translation);
        const double error = at ? (*at - seen.at.cwiseProduct(size)).norm() / size.maxCoeff() : 1;
        errors.push_back(error < 1 ? error : 1);
    }
    return median(std::move(errors));
}

std::vector<bool> far_cameras(const std::vector<Eigen::Vector3d>& centers) {
    // The farthest camera is at 1.1 to 2.8 median distances in captures of objects, rooms and buildings, and at 2 on a
    // straight line.
    constexpr double kFar = 6;
    constexpr std::size_t kFewest = 5;
    std::vector<bool> far(centers.size());
    if (centers.size() < kFewest) return far;
    const std::vector<double> distances = distances_from_middle(centers);
    for (std::size_t i = 0; i < far.size(); ++i) far[i] = distances[i] > kFar;
    if (!are_few(std::size_t(std::count(far.begin(), far.end(), true)), far.size())) far.assign(far.size(), false);
    return far;
}

void leave_out_wrong_poses(const std::vector<SourceView>& views, const SourcePoints& points,
                           std::vector<ViewRole>& roles, std::vector<std::string>& notes) {
    std::vector<std::size_t> used;
    std::vector<Eigen::Vector3d> centers;
    for (std::size_t i = 0; i < views.size(); ++i)
        if (roles[i] != ViewRole::kLeftOut) {
            used.push_back(i);
            centers.push_back(views[i].center());
        }
    std::vector<std::optional<double>> errors;
    for (const SourceView& view : views) errors.push_back(track_error(view));
    const std::vector<bool> contradicted = contradict_tracks(errors), far = far_cameras(centers);
    const std::vector<double> distances = distances_from_middle(centers);
    std::vector<std::string> off, lost, distant, scored;
    double worst = 0, farthest = 0;
    for (std::size_t k = 0; k < used.size(); ++k) {
        const SourceView& view = views[used[k]];
        const bool sees_nothing =
            far[k] && !errors[used[k]] && !points.positions.empty() && !sees_a_point(view, points);
        if (far[k]) farthest = std::max(farthest, distances[k]);
        if (contradicted[used[k]]) worst = std::max(worst, *errors[used[k]]);
        if (!contradicted[used[k]] && !sees_nothing) {
            if (far[k]) distant.push_back(view.name);
            continue;
        }
        if (roles[used[k]] == ViewRole::kTest) {
            scored.push_back(view.name);
            continue;
        }
        (contradicted[used[k]] ? off : lost).push_back(view.name);
        roles[used[k]] = ViewRole::kLeftOut;
    }
    if (!off.empty())
        notes.push_back(fmt::format(
            "{} of {} images are left out of the training, since their poses contradict the points that they "
            "see, by up to {:.0f} % of the image's size ({})",
            off.size(), used.size(), 100 * worst, listed(off)));
    if (!lost.empty())
        notes.push_back(
            fmt::format("{} of {} images are left out of the training, since their cameras stand far outside of the "
                        "others, up to {:.3g} times the median distance from their middle, and see none of the points "
                        "({})",
                        lost.size(), used.size(), farthest, listed(lost)));
    if (!distant.empty())
        notes.push_back(fmt::format(
            "{} of {} cameras stand far outside of the others, up to {:.3g} times the median distance from their "
            "middle: the size of the scene, and with it the learning rates of positions, does not follow from them "
            "({})",
            distant.size(), used.size(), farthest, listed(distant)));
    if (!scored.empty())
        notes.push_back(fmt::format("{} test images have poses that cannot be right, and are scored all the same ({})",
                                    scored.size(), listed(scored)));
}

}  // namespace gs
