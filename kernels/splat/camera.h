// SPDX-License-Identifier: Apache-2.0
// The pinhole camera the kernels see.
#pragma once

#include "kernels/core/vec.h"

namespace gs {

/// World space right-handed; camera x right, y down, z forward; pixel centres at .5
/// (docs/math/rasterizer.md#conventions).
template <class T> struct CameraParams {
    Mat3<T> rotation;      ///< of cam_from_world
    Vec3<T> translation;   ///< of cam_from_world, world units
    Vec3<T> position;      ///< camera centre in the world: -R^T t
    T fx, fy, cx, cy;      ///< pixels, principal point measured from the image corner
    int width, height;     ///< pixels
    T near_plane = T(0.2); ///< Gaussians nearer than this (camera z, world units) are culled
    T far_plane = T(10000);
};

}  // namespace gs
