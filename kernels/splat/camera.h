// SPDX-License-Identifier: Apache-2.0
// The camera of the kernels.
#pragma once

#include "kernels/base/vec.h"
#include "kernels/splat/lens_device.h"

namespace gs {

/// A camera, with a lens or without. World space is right-handed; the camera's x points right, y down, z forward; pixel
/// centres are at .5 (docs/math/rasterizer.md#conventions).
template <class T> struct CameraParams {
    Mat3<T> rotation;     ///< rotation of cam_from_world
    Vec3<T> translation;  ///< translation of cam_from_world, frame units
    Vec3<T> position;     ///< camera centre in the world: -R^T t
    T fx, fy, cx, cy;     ///< pixels; the principal point is measured from the image corner
    int width, height;    ///< pixels
    /// Gaussians nearer than this are culled, in frame units: by their depth (depth_of()).
    T near_plane = T(0.2);
    T far_plane = T(10000);
    Lens<T> lens = {};

    /// Returns the distance in pixels after which the image repeats, or 0.
    GS_HD T period() const { return lens.wraps() ? T(width) : T(0); }
    /// Returns the focal length of the pinholes that draw on the faces of a lens, so that their pixels are about as
    /// large as those on screen.
    GS_HD T face_focal() const { return lens.wraps() ? fx * T(0.15915494309189535) : fx; }
};

/// Returns whether two cameras have the same pixels, focal lengths and lens, whatever their poses.
template <class T> bool has_same_rays(const CameraParams<T>& a, const CameraParams<T>& b) {
    bool same = a.width == b.width && a.height == b.height && a.fx == b.fx && a.fy == b.fy && a.cx == b.cx &&
                a.cy == b.cy && a.lens.model == b.lens.model && a.lens.max_angle == b.lens.max_angle;
    for (int k = 0; k < 12; ++k) same = same && a.lens.distortion[k] == b.lens.distortion[k];
    return same;
}

/// Returns the camera in another scalar; of(x) converts a number.
template <class T, class U, class Of> CameraParams<T> converted(const CameraParams<U>& c, Of&& of) {
    const auto vec = [&](const Vec3<U>& v) { return Vec3<T>{of(v.x), of(v.y), of(v.z)}; };
    CameraParams<T> out{{vec(c.rotation.r0), vec(c.rotation.r1), vec(c.rotation.r2)},
                        vec(c.translation),
                        vec(c.position),
                        of(c.fx),
                        of(c.fy),
                        of(c.cx),
                        of(c.cy),
                        c.width,
                        c.height,
                        of(c.near_plane),
                        of(c.far_plane)};
    out.lens.model = c.lens.model;
    for (int k = 0; k < 12; ++k) out.lens.distortion[k] = of(c.lens.distortion[k]);
    out.lens.max_angle = of(c.lens.max_angle), out.lens.slope = of(c.lens.slope);
    out.lens.sin_max = of(c.lens.sin_max), out.lens.cos_max = of(c.lens.cos_max);
    out.lens.cos_drawn = of(c.lens.cos_drawn);
    out.lens.as_pinholes = c.lens.as_pinholes;
    return out;
}

}  // namespace gs
