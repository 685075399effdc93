// SPDX-License-Identifier: Apache-2.0
// What a camera has of a point.
#pragma once

#include <Eigen/Core>

#include "kernels/splat/camera.h"
#include "lib/scene/scene.h"

namespace gs {

/// What a camera has of a point, from worst to best.
enum class Seen {
    kNot,      ///< outside the image or behind the camera
    kClipped,  ///< in the image, but before the near or behind the far plane
    kDrawn,
};

/// Returns what the rasterizer makes of a Gaussian's centre at `point`, in the camera's units.
inline Seen seen(const Camera& camera, const Eigen::Vector3d& point) {
    const CameraParams<double> planes{};
    const Eigen::Vector3d p = camera.rotation * point + camera.translation;
    if (!(p.z() > 0)) return Seen::kNot;
    const double x = camera.fx * p.x() / p.z() + camera.cx, y = camera.fy * p.y() / p.z() + camera.cy;
    if (!(x >= 0 && y >= 0 && x < camera.width && y < camera.height)) return Seen::kNot;
    return p.z() >= planes.near_plane && p.z() <= planes.far_plane ? Seen::kDrawn : Seen::kClipped;
}

}  // namespace gs
