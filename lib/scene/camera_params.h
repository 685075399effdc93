// SPDX-License-Identifier: Apache-2.0
// Converts a scene's camera to the kernels' parameters, and classifies the visibility of a point.
#pragma once

#include <Eigen/Core>

#include "kernels/splat/camera.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the kernels' parameters of a camera, in pixels and frame units.
template <class T = float> CameraParams<T> camera_params(const Camera& c) {
    const auto row = [&](int r) { return Vec3<T>{T(c.rotation(r, 0)), T(c.rotation(r, 1)), T(c.rotation(r, 2))}; };
    const Eigen::Vector3d o = c.center();
    CameraParams<T> p{};
    p.rotation = {row(0), row(1), row(2)};
    p.translation = {T(c.translation.x()), T(c.translation.y()), T(c.translation.z())};
    p.position = {T(o.x()), T(o.y()), T(o.z())};
    p.fx = T(c.fx), p.fy = T(c.fy), p.cx = T(c.cx), p.cy = T(c.cy);
    p.width = c.width, p.height = c.height;
    p.lens = kernel_lens<T>(c, c.range);
    return p;
}

/// Visibility of a point in a camera, from worst to best.
enum class Seen {
    kNot,      ///< outside the image or behind the camera
    kClipped,  ///< in the image, but nearer than the near plane or beyond the far plane
    kDrawn,
};

/// Returns the visibility, for the rasterizer, of a Gaussian centred at `point`, in the world coordinates of the
/// camera.
inline Seen seen(const Camera& camera, const Eigen::Vector3d& point) {
    const CameraParams<double> planes{};
    const Eigen::Vector3d p = camera.rotation * point + camera.translation;
    if (!camera.is_used_at(p)) return Seen::kNot;
    const std::optional<Eigen::Vector2d> at = project(camera, p);
    if (!at || !(at->x() >= 0 && at->y() >= 0 && at->x() < camera.width && at->y() < camera.height)) return Seen::kNot;
    const double depth = is_pinhole(camera) ? p.z() : p.norm();
    return depth >= planes.near_plane && depth <= planes.far_plane ? Seen::kDrawn : Seen::kClipped;
}

}  // namespace gs
