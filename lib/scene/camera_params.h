// SPDX-License-Identifier: Apache-2.0
// Converts a scene's camera to the form that the kernels take.
#pragma once

#include "kernels/splat/camera.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the kernels' parameters of a pinhole camera, in pixels and world units.
template <class T = float> CameraParams<T> camera_params(const Camera& c) {
    const auto row = [&](int r) { return Vec3<T>{T(c.rotation(r, 0)), T(c.rotation(r, 1)), T(c.rotation(r, 2))}; };
    const Eigen::Vector3d o = c.center();
    CameraParams<T> p{};
    p.rotation = {row(0), row(1), row(2)};
    p.translation = {T(c.translation.x()), T(c.translation.y()), T(c.translation.z())};
    p.position = {T(o.x()), T(o.y()), T(o.z())};
    p.fx = T(c.fx), p.fy = T(c.fy), p.cx = T(c.cx), p.cy = T(c.cy);
    p.width = c.width, p.height = c.height;
    return p;
}

}  // namespace gs
