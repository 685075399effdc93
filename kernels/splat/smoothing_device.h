// SPDX-License-Identifier: Apache-2.0
// The 3-D filter of Mip-Splatting (docs/math/rasterizer.md#antialiasing): its variance by the views of a Gaussian, and
// the Gaussian that it makes.
#pragma once

#include "kernels/splat/projection_device.h"

namespace gs {

/// Returns the pixels per unit of length across the view at `mean`, or 0 if the camera does not see it within the
/// margin of the projection.
template <class T> GS_HD T pixels_per_unit(const Vec3<T>& mean, const CameraParams<T>& cam) {
    const Vec3<T> point = camera_point(mean, cam);
    const T distance = cam.lens.is_pinhole() ? point.z : gs_sqrt(dot(point, point));
    if (!(distance >= cam.near_plane && distance <= cam.far_plane)) return T(0);
    T u = point.x / distance, v = point.y / distance;
    T area = cam.fx * cam.fy;  // square pixels per square unit at distance 1
    if (!cam.lens.is_pinhole()) {
        if (!cam.lens.reaches(point, distance)) return T(0);
        const Vec3<T> direction = point * (T(1) / distance);
        Vec3<T> e1, e2;
        tangent_basis(direction, e1, e2);
        const LensPoint<T> at = lens_point_at(cam.lens, direction, e1, e2);
        u = at.x.value, v = at.y.value;
        area = area * gs_abs(at.x.x * at.y.y - at.x.y * at.y.x);
    }
    const T x = cam.fx * u + cam.cx, y = cam.fy * v + cam.cy, w = T(cam.width), h = T(cam.height);
    const T m = T(kFrustumMargin);
    const bool inside = x >= -m * w && x <= (T(1) + m) * w && y >= -m * h && y <= (T(1) + m) * h;
    return inside ? gs_sqrt(area) / distance : T(0);
}

/// Returns the variance of the 3-D filter of a Gaussian at `mean`, frame units squared: kSmoothingVariance in the view
/// with the most pixels per unit. 0 if no view sees it: then none asks for a limit.
template <class T> GS_HD T smoothing_variance(const Vec3<T>& mean, const CameraParams<T>* cameras, int num_cameras) {
    T most = T(0);
    for (int k = 0; k < num_cameras; ++k) most = gs_max(most, pixels_per_unit(mean, cameras[k]));
    return most > T(0) ? T(kSmoothingVariance) / (most * most) : T(0);
}

/// A scale and an opacity that look, with the dilation of an antialiased model, like others with a 3-D filter.
template <class T> struct SmoothedGaussian {
    Vec3<T> log_scale;
    T raw_opacity;
};

template <class T> GS_HD SmoothedGaussian<T> smoothed(const Vec3<T>& log_scale, T raw_opacity, T smoothing) {
    const Vec3<T> own = activated_variance(log_scale), v = own + Vec3<T>{smoothing, smoothing, smoothing};
    const T factor = gs_sqrt(squared_smoothing_factor(own, v)), opacity = sigmoid(raw_opacity) * factor;
    // An axis that was flat stays so without a filter, and the factor of such an axis is 0/0.
    if (!(smoothing > T(0))) return {log_scale, raw_opacity};
    return {{T(0.5) * gs_log(v.x), T(0.5) * gs_log(v.y), T(0.5) * gs_log(v.z)}, gs_log(opacity / (T(1) - opacity))};
}

}  // namespace gs
