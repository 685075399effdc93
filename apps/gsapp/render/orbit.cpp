// SPDX-License-Identifier: Apache-2.0
// Fits orbits to the training cameras.
#include "apps/gsapp/render/orbit.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <charconv>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/core/median.h"
#include "lib/model/whole_model.h"
#include "lib/scene/frame.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

using Eigen::Vector3d;

/// Largest coordinate: beyond any scene, and its square is finite as a float.
constexpr double kLargest = 1e15;

/// Parses a number at the beginning of `rest` and removes it from there.
std::optional<double> take_number(std::string_view& rest) {
    double value = 0;
    const auto [end, error] = std::from_chars(rest.data(), rest.data() + rest.size(), value);
    if (error != std::errc{} || !(std::abs(value) <= kLargest)) return std::nullopt;
    rest.remove_prefix(std::size_t(end - rest.data()));
    return value;
}

/// Returns the horizontal direction that a model's front faces by convention: +z if +y is up (glTF), -z if -y is up
/// (COLMAP and 3DGS), and -y if z is up (CAD and Blender). The web viewer opens such models from the same side.
Vector3d front_of(const Vector3d& up) {
    Eigen::Index main = 0;
    up.cwiseAbs().maxCoeff(&main);
    const Vector3d front =
        main == 2 ? Vector3d(0, up.z() > 0 ? -1 : 1, 0) : Vector3d(0, 0, main == 1 && up.y() < 0 ? -1 : 1);
    return (front - front.dot(up) * up).normalized();
}

}  // namespace

OrbitRadius parse_orbit_radius(const std::string& text) {
    std::string_view rest = text;
    const auto value = take_number(rest);
    if (!value || !(*value > 0) || !(rest.empty() || rest == "x"))
        throw UsageError(
            fmt::format("--orbit-radius {}: it is a length above 0 in scene units, such as 2.5, or a "
                        "multiple of the usual distance, such as 1.5x",
                        text));
    return {*value, rest == "x"};
}

Vector3d parse_orbit_target(const std::string& text) {
    std::string_view rest = text;
    Vector3d target;
    for (int i = 0; i < 3; ++i) {
        const auto value = take_number(rest);
        const bool ends = i == 2 ? rest.empty() : rest.starts_with(',');
        if (!value || !ends)
            throw UsageError(fmt::format("--orbit-target {}: it is X,Y,Z in scene coordinates, such as 0,0,0.5", text));
        target[i] = *value;
        if (i < 2) rest.remove_prefix(1);
    }
    return target;
}

Vector3d parse_axis(const std::string& text) {
    const bool is_negative = text.starts_with('-');
    const std::size_t axis = std::string("xyz").find(text.substr(is_negative ? 1 : 0));
    if (text.size() != (is_negative ? 2u : 1u) || axis > 2)
        throw UsageError(fmt::format("--orbit-up {}: it is x, y, z, -x, -y or -z", text));
    return Vector3d::Unit(Eigen::Index(axis)) * (is_negative ? -1 : 1);
}

View usual_view(const Gaussians& model, OrbitShape& shape, const Frame& frame) {
    constexpr int kWidth = 1280, kHeight = 720;
    constexpr double kFieldOfView = 50 * M_PI / 180, kElevation = 20 * M_PI / 180;
    constexpr double kDistance = 3;  ///< times the median distance; a sphere of that radius fills 0.7 of the height
    const Vector3d center = median_center(model);
    if (!shape.target) shape.target = frame.to_scene(center);
    if (!shape.up) shape.up = -Vector3d::UnitY();
    std::vector<double> distances;
    for (std::int64_t i = 0; i < model.count; ++i)
        distances.push_back((Eigen::Vector3f(model[Group::kMean].param.data() + 3 * i).cast<double>() - center).norm());
    const double spread = distances.empty() ? 0 : median(std::move(distances));
    const double distance = std::max(kDistance * spread, 1e-3);
    const Vector3d side = front_of(*shape.up);
    View view;
    view.camera.width = kWidth, view.camera.height = kHeight;
    view.camera.fx = view.camera.fy = 0.5 * kHeight / std::tan(0.5 * kFieldOfView);
    view.camera.cx = 0.5 * kWidth, view.camera.cy = 0.5 * kHeight;
    const Vector3d position =
        frame.from_scene(*shape.target) + distance * (std::cos(kElevation) * side + std::sin(kElevation) * *shape.up);
    view.camera.translation = -view.camera.rotation * position;
    return view;
}

std::vector<Camera> orbit_path(const std::vector<View>& views, const OrbitShape& shape, const Frame& frame) {
    if (views.empty()) throw UsageError("an orbit needs the cameras of at least one view");
    if (shape.count < 1) throw UsageError(fmt::format("--orbit: {} is below 1", shape.count));
    const Vector3d target = shape.target ? frame.from_scene(*shape.target) : common_target(views);
    Vector3d up = Vector3d::Zero();
    for (const View& view : views) up -= view.camera.rotation.row(1).transpose();
    if (shape.up) up = *shape.up;
    up = up.norm() > 1e-9 ? up.normalized() : Vector3d::UnitZ();
    double height = 0, radius = 0;
    for (const View& view : views) {
        const Vector3d offset = view.camera.center() - target;
        height += offset.dot(up) / double(views.size());
        radius += (offset - offset.dot(up) * up).norm() / double(views.size());
    }
    if (radius < 1e-6) radius = 1;  // all cameras are directly above or below the target
    if (!shape.radius.is_factor || shape.radius.value != 1) {
        const double factor =
            shape.radius.is_factor ? shape.radius.value : shape.radius.value * frame.scale / std::hypot(radius, height);
        radius *= factor, height *= factor;
    }
    if (shape.elevation) {
        const double distance = std::hypot(radius, height), angle = *shape.elevation * M_PI / 180;
        radius = distance * std::cos(angle), height = distance * std::sin(angle);
    }
    // Starts at the first camera's direction, or at an arbitrary one if that camera is on the axis.
    Vector3d start = views[0].camera.center() - target;
    start -= start.dot(up) * up;
    if (start.norm() < 1e-9) start = up.unitOrthogonal();
    const Vector3d e0 = start.normalized(), e1 = up.cross(e0);
    std::vector<Camera> cameras;
    for (int i = 0; i < shape.count; ++i) {
        const double angle = 2 * M_PI * i / shape.count;
        const Vector3d offset = radius * (std::cos(angle) * e0 + std::sin(angle) * e1) + height * up;
        const Vector3d forward = -offset.normalized(), right = forward.cross(up).normalized();
        Camera camera = without_lens(views[0].camera);
        camera.rotation.row(0) = right;
        camera.rotation.row(1) = forward.cross(right);
        camera.rotation.row(2) = forward;
        camera.translation = -camera.rotation * (target + offset);
        cameras.push_back(camera);
    }
    return cameras;
}

}  // namespace gs
