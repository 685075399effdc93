// SPDX-License-Identifier: Apache-2.0
// The pinhole camera of the kernels.
#pragma once

#include "kernels/base/vec.h"

namespace gs {

/// A pinhole camera. World space is right-handed; the camera's x points right, y down, z forward; pixel centres are at
/// .5 (docs/math/rasterizer.md#conventions).
template <class T> struct CameraParams {
    Mat3<T> rotation;       ///< rotation of cam_from_world
    Vec3<T> translation;    ///< translation of cam_from_world, frame units
    Vec3<T> position;       ///< camera centre in the world: -R^T t
    T fx, fy, cx, cy;       ///< pixels; the principal point is measured from the image corner
    int width, height;      ///< pixels
    T near_plane = T(0.2);  ///< Gaussians nearer than this (camera z, frame units) are culled
    T far_plane = T(10000);
};

}  // namespace gs
