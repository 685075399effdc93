// SPDX-License-Identifier: Apache-2.0
// The gradient of the loss of a view by its camera (docs/math/rasterizer.md#camera-gradient).
#pragma once

#include "kernels/base/vec.h"

namespace gs {

/// The gradient of a view's loss by the camera that draws it.
template <class T> struct CameraGradient {
    Vec3<T> position;  ///< by the camera's centre, world axes, per frame unit
    Vec3<T> rotation;  ///< by a vector w in world axes, radians, for a camera turned to rotation * exp([w]x)
    T fx, fy, cx, cy;  ///< by focal lengths and principal point, per pixel
    T distortion;      ///< by the first coefficient of distortion, which is not that of a pinhole

    static constexpr int kSize = 11;

    /// Calls fn(k, number) for each of its numbers.
    template <class Fn> GS_HD void for_each(Fn&& fn) {
        fn(0, position.x), fn(1, position.y), fn(2, position.z);
        fn(3, rotation.x), fn(4, rotation.y), fn(5, rotation.z);
        fn(6, fx), fn(7, fy), fn(8, cx), fn(9, cy), fn(10, distortion);
    }
};

}  // namespace gs
