// SPDX-License-Identifier: Apache-2.0
// The projection of one Gaussian to the image (docs/math/rasterizer.md#projection, #footprint), the exact tile test
// (docs/math/rasterizer.md#tile-test), and the projection's gradient (docs/math/rasterizer.md#projection-gradient).
#pragma once

#include "kernels/base/lanes.h"
#include "kernels/splat/camera.h"
#include "kernels/splat/raster_config.h"
#include "kernels/splat/splat_device.h"

namespace gs {

/// The geometry of one Gaussian as stored (raw).
template <class T> struct GaussianGeometry {
    Vec3<T> mean;  ///< frame units
    Vec3<T> log_scale;
    Vec4<T> rotation;          ///< (w,x,y,z) in the fields (x,y,z,w), so that x holds w; unnormalised
    T raw_opacity;             ///< logit
    T smoothing{};             ///< variance of the 3-D filter, frame units squared
    bool antialiased = false;  ///< as in GaussianState
};

/// A half-open rectangle of pixels.
struct PixelBounds {
    int x_min, x_max, y_min, y_max;
};

/// The intermediate results common to the forward and backward pass. The backward pass recomputes them instead of
/// storing them.
template <class T> struct Projection {
    Vec3<T> cam;         ///< mean in camera space
    T depth;             ///< depth_of(cam)
    T distance{};        ///< of cam from the origin, through a lens only
    T u, v, uc, vc;      ///< normalised image coordinates, and their values clipped for the Jacobian of a pinhole
    Mat3<T> rotation;    ///< R(q)
    Vec3<T> variance;    ///< exp(2 s), and the 3-D filter
    Sym3<T> covariance;  ///< R diag(variance) R^T, world
    T j11, j22;          ///< fx/z, fy/z
    Vec3<T> a1, a2;      ///< rows of J W
    LensPoint<T> at{};   ///< through a lens only
    Sym2<T> cov2d;       ///< with dilation
    T det;
    T undilated_det{}, compensation{};  ///< antialiased only: det without dilation, and the factor of the opacity
};

/// Returns R(q) for an unnormalised q = (w,x,y,z).
template <class T> GS_HD Mat3<T> rotation_matrix(const Vec4<T>& q) {
    const T r = q.x, x = q.y, y = q.z, z = q.w;
    const T s = T(2) / (r * r + x * x + y * y + z * z);
    return {{T(1) - s * (y * y + z * z), s * (x * y - r * z), s * (x * z + r * y)},
            {s * (x * y + r * z), T(1) - s * (x * x + z * z), s * (y * z - r * x)},
            {s * (x * z - r * y), s * (y * z + r * x), T(1) - s * (x * x + y * y)}};
}

template <class T> GS_HD T norm2(const Vec4<T>& q) { return q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w; }

/// Returns whether a quaternion has a direction: it has none if it is too short, too long for float, or NaN.
template <class T> GS_HD bool usable_rotation(const Vec4<T>& q) {
    return norm2(q) >= T(kMinQuaternionNorm2) && norm2(q) <= T(kMaxQuaternionNorm2);
}

template <class T> GS_HD Sym3<T> world_covariance(const Mat3<T>& r, const Vec3<T>& var) {
    const Vec3<T> m0 = r.r0 * var, m1 = r.r1 * var, m2 = r.r2 * var;
    return {dot(m0, r.r0), dot(m0, r.r1), dot(m0, r.r2), dot(m1, r.r1), dot(m1, r.r2), dot(m2, r.r2)};
}

template <class T> GS_HD Vec3<T> activated_variance(const Vec3<T>& s) {
    const T m = T(kMaxLogScale);
    return {gs_exp(T(2) * gs_min(s.x, m)), gs_exp(T(2) * gs_min(s.y, m)), gs_exp(T(2) * gs_min(s.z, m))};
}

/// Returns the factor of an antialiased Gaussian's opacity by its 3-D filter, squared. `smoothed` includes the filter.
template <class T> GS_HD T squared_smoothing_factor(const Vec3<T>& variance, const Vec3<T>& smoothed) {
    return variance.x / smoothed.x * (variance.y / smoothed.y) * (variance.z / smoothed.z);
}

/// Returns the determinant of the covariance on screen without dilation. q = R^T n, n the cross product of the rows of
/// J W, v the variances. Its terms have one sign, and do not cancel even for needles.
template <class T> GS_HD T projected_determinant(const Vec3<T>& q, const Vec3<T>& v) {
    return q.x * q.x * v.y * v.z + q.y * q.y * v.x * v.z + q.z * q.z * v.x * v.y;
}

/// Computes the covariance on screen from the rows of J W, and for an antialiased Gaussian the factor of its opacity.
template <class T> GS_HD void project_covariance(const GaussianGeometry<T>& g, Projection<T>& p) {
    p.rotation = rotation_matrix(g.rotation);
    p.variance = activated_variance(g.log_scale);
    if (g.antialiased) {
        const Vec3<T> own = p.variance;
        p.variance += Vec3<T>{g.smoothing, g.smoothing, g.smoothing};
        p.compensation = squared_smoothing_factor(own, p.variance);
        p.undilated_det = projected_determinant(p.rotation.transposed_times(cross(p.a1, p.a2)), p.variance);
    }
    p.covariance = world_covariance(p.rotation, p.variance);
    const Vec3<T> sa1 = p.covariance * p.a1, sa2 = p.covariance * p.a2;
    const T dilation = T(g.antialiased ? kAntialiasedDilation : kDilation);
    p.cov2d = {dot(p.a1, sa1) + dilation, dot(p.a1, sa2), dot(p.a2, sa2) + dilation};
    p.det = p.cov2d.xx * p.cov2d.yy - p.cov2d.xy * p.cov2d.xy;
    if (g.antialiased) {
        const T det = p.undilated_det + dilation * (p.cov2d.xx + p.cov2d.yy - dilation);
        p.compensation = gs_sqrt(p.compensation * (p.undilated_det / det));
    }
}

/// Computes steps 4 to 8 of the forward pass for the mean in p.cam. No branch depends on the Gaussian, so T may also be
/// lanes.
template <class T>
GS_HD void project_shape(const GaussianGeometry<T>& g, const CameraParams<T>& cam, Projection<T>& p) {
    const T inv_z = T(1) / p.cam.z;
    p.u = p.cam.x * inv_z;
    p.v = p.cam.y * inv_z;
    const T w = T(cam.width), h = T(cam.height), m = T(kFrustumMargin);
    p.uc = gs_clamp(p.u, (-m * w - cam.cx) / cam.fx, ((T(1) + m) * w - cam.cx) / cam.fx);
    p.vc = gs_clamp(p.v, (-m * h - cam.cy) / cam.fy, ((T(1) + m) * h - cam.cy) / cam.fy);
    p.j11 = cam.fx * inv_z;
    p.j22 = cam.fy * inv_z;
    const Vec3<T>& r3 = cam.rotation.r2;
    p.a1 = (cam.rotation.r0 - r3 * p.uc) * p.j11;
    p.a2 = (cam.rotation.r1 - r3 * p.vc) * p.j22;
    project_covariance(g, p);
}

/// Computes the image point of the mean in p.cam through the lens, and the rows of J W.
template <class T> GS_HD void project_through_lens(const CameraParams<T>& cam, Projection<T>& p) {
    p.at = lens_point_at(cam.lens, p.cam, p.distance);
    const LensPoint<T>& at = p.at;
    p.u = at.x.value, p.v = at.y.value;
    const T inverse = T(1) / p.distance;
    const Vec3<T> w1 = cam.rotation.transposed_times(at.e1), w2 = cam.rotation.transposed_times(at.e2);
    p.a1 = (w1 * at.x.x + w2 * at.x.y) * (cam.fx * inverse);
    p.a2 = (w1 * at.y.x + w2 * at.y.y) * (cam.fy * inverse);
}

/// Transforms a mean to the camera's frame: step 2 of the forward pass.
template <class T> GS_HD Vec3<T> camera_point(const Vec3<T>& mean, const CameraParams<T>& cam) {
    return cam.rotation * mean + cam.translation;
}

/// Returns the depth of a point in camera space, which orders blending: the camera's z, or with a lens the distance or
/// the largest coordinate.
template <class T> GS_HD T depth_of(const Vec3<T>& point, const CameraParams<T>& cam) {
    if (cam.lens.is_pinhole()) return point.z;
    if (!cam.lens.pinhole_depth) return gs_sqrt(dot(point, point));
    return gs_max(gs_max(gs_abs(point.x), gs_abs(point.y)), gs_abs(point.z));
}

/// Computes steps 2 and 4 to 8 of the forward pass. Returns false if the Gaussian is culled. Every test is written
/// positively, so that NaN fails it.
template <class T>
GS_HD bool project_geometry(const GaussianGeometry<T>& g, const CameraParams<T>& cam, Projection<T>& p) {
    p.cam = camera_point(g.mean, cam);
    p.depth = depth_of(p.cam, cam);
    if (!(p.depth >= cam.near_plane && p.depth <= cam.far_plane)) return false;
    if (!usable_rotation(g.rotation)) return false;
    if (cam.lens.is_pinhole()) {
        project_shape(g, cam, p);
    } else {
        p.distance = gs_sqrt(dot(p.cam, p.cam));
        if (!cam.lens.reaches(p.cam, p.distance)) return false;
        project_through_lens(cam, p);
        project_covariance(g, p);
    }
    return p.det >= T(kMinDeterminant) && p.cov2d.xx <= T(kMaxVariance2d) && p.cov2d.yy <= T(kMaxVariance2d);
}

/// A half-open rectangle of pixels with integer values stored as floating point.
template <class T> struct Rectangle { T x_min, x_max, y_min, y_max; };

/// Returns the pixel rectangle of the ellipse alpha >= 1/255, clamped to [0, width_padded] x [0, height_padded].
template <class T>
GS_HD Rectangle<T> ellipse_bounds(const Vec2<T>& m, const Sym2<T>& cov2d, T threshold, T width_padded,
                                  T height_padded) {
    const T hx = gs_max(gs_sqrt(T(2) * threshold * cov2d.xx) - T(0.5), T(0));
    const T hy = gs_max(gs_sqrt(T(2) * threshold * cov2d.yy) - T(0.5), T(0));
    return {gs_clamp(gs_floor(m.x - hx), T(0), width_padded), gs_clamp(gs_ceil(m.x + hx), T(0), width_padded),
            gs_clamp(gs_floor(m.y - hy), T(0), height_padded), gs_clamp(gs_ceil(m.y + hy), T(0), height_padded)};
}

/// Returns the same rectangle as integers. Means far off axis exceed the range of int, so they are clamped first.
template <class T>
GS_HD PixelBounds pixel_bounds(const Vec2<T>& m, const Sym2<T>& cov2d, T threshold, int width_padded,
                               int height_padded) {
    const Rectangle<T> r = ellipse_bounds(m, cov2d, threshold, T(width_padded), T(height_padded));
    return {int(r.x_min), int(r.x_max), int(r.y_min), int(r.y_max)};
}

/// Returns the x at which a splat is nearest to x0, if the image repeats after `period` pixels.
template <class T> GS_HD T nearest_repeat(T x, T x0, T period) {
    return x + period * gs_floor((x0 - x) / period + T(0.5));
}

/// An ellipse on screen: its centre, pixels, and the covariance of the Gaussian that has it as a level set.
template <class T> struct Outline {
    Vec2<T> center;
    Sym2<T> cov2d;
};

/// Returns an ellipse that holds all pixels which a splat through a lens may reach: those whose power is at most
/// `threshold`, as the level set of this power. `mean` is the image point of the mean.
template <class T>
GS_HD Outline<T> lens_outline(const CameraParams<T>& cam, const Projection<T>& p, const Vec2<T>& mean, T threshold) {
    constexpr double kPi = 3.14159265358979323846;
    const T g11 = cam.fx * p.at.x.x, g12 = cam.fx * p.at.x.y, g21 = cam.fy * p.at.y.x, g22 = cam.fy * p.at.y.y;
    const T of_g = T(1) / (g11 * g22 - g12 * g21);
    // The largest extent in the tangent plane: the sine of an angle.
    const Sym2<T>& s = p.cov2d;
    const T v1 = (g22 * g22 * s.xx - T(2) * g22 * g12 * s.xy + g12 * g12 * s.yy) * of_g * of_g;
    const T v2 = (g21 * g21 * s.xx - T(2) * g21 * g11 * s.xy + g11 * g11 * s.yy) * of_g * of_g;
    const T v12 = (g22 * g11 * s.xy - g22 * g21 * s.xx - g12 * g11 * s.yy + g12 * g21 * s.xy) * of_g * of_g;
    const T h2 = T(2) * threshold;
    const T rho2 = h2 * (T(0.5) * (v1 + v2) + gs_sqrt(T(0.25) * (v1 - v2) * (v1 - v2) + v12 * v12)),
            rho = gs_sqrt(rho2);
    if (!(rho < T(kMostLensExtent))) return {mean, {T(kMaxVariance2d), T(0), T(kMaxVariance2d)}};
    // Near the poles of a 360-degree image the outline is a band of rows.
    if (cam.lens.wraps() && rho > T(0.7) * gs_sqrt(gs_max(T(1) - p.at.axis.y * p.at.axis.y, T(0)))) {
        const T rows = gs_atan2(rho, gs_sqrt(T(1) - rho2)) * cam.fy * T(1 / kPi);
        return {mean, {T(kMaxVariance2d), T(0), rows * rows / h2}};
    }
    const auto norm2 = [](const Jet<T>& j, T focal) {
        return focal * focal * (j.xx * j.xx + T(2) * j.xy * j.xy + j.yy * j.yy);
    };
    // The image point is off its linear continuation by half the second derivatives, and by terms of the third order.
    const T bend = T(0.65) * gs_sqrt(norm2(p.at.x, cam.fx) + norm2(p.at.y, cam.fy)) * rho2 +
                   T(2) * gs_sqrt(g11 * g11 + g12 * g12 + g21 * g21 + g22 * g22) * rho * rho2;
    const T half = T(0.5) * (s.xx + s.yy), apart = T(0.5) * (s.xx - s.yy);
    const T least = gs_max(half - gs_sqrt(apart * apart + s.xy * s.xy), T(kMinDeterminant));
    const T ratio = bend / gs_sqrt(h2 * least);
    if (ratio < T(0.05)) {
        // The ellipse sqrt(h2 S) and a disc of radius `bend`, added up, lie in this multiple of the ellipse.
        const T grow = (T(1) + ratio) * (T(1) + ratio);
        return {mean, {grow * s.xx, grow * s.xy, grow * s.yy}};
    }
    // Points of a circle that L = chol(h2 S) maps to the ellipse, and the offsets of the contour from it.
    constexpr int kPoints = 24;
    const T turn_cosine = T(0.96592582628906829), turn_sine = T(0.25881904510252076);
    const T l11 = gs_sqrt(h2 * s.xx), l21 = h2 * s.xy / l11, l22 = gs_sqrt(h2 * p.det / s.xx);
    Vec2<T> circle[kPoints], off[kPoints], center{T(0), T(0)};
    for (int k = 0; k < kPoints; ++k) {
        const Vec2<T> u = k == 0 ? Vec2<T>{T(1), T(0)}
                                 : Vec2<T>{turn_cosine * circle[k - 1].x - turn_sine * circle[k - 1].y,
                                           turn_sine * circle[k - 1].x + turn_cosine * circle[k - 1].y};
        const Vec2<T> e{l11 * u.x, l21 * u.x + l22 * u.y};
        const T y1 = (g22 * e.x - g12 * e.y) * of_g, y2 = (g11 * e.y - g21 * e.x) * of_g;
        const Vec2<T> at =
            lens_point(cam.lens, p.at.axis * gs_sqrt(T(1) - y1 * y1 - y2 * y2) + p.at.e1 * y1 + p.at.e2 * y2);
        T x = cam.fx * at.x + cam.cx;
        if (cam.lens.wraps()) x = nearest_repeat(x, mean.x, cam.period());
        circle[k] = u, off[k] = Vec2<T>{x, cam.fy * at.y + cam.cy} - mean - e;
        center = center + off[k] * T(1.0 / kPoints);
    }
    // An ellipse that is longer along these offsets, L M L^T, and large enough for all of its points and between.
    const T share = T(4.0 / kPoints);
    Sym2<T> m{T(1), T(0), T(1)};
    for (Vec2<T>& d : off) {
        const T x = (d.x - center.x) / l11;
        d = {x, (d.y - center.y - l21 * x) / l22};
        m = {m.xx + share * d.x * d.x, m.xy + share * d.x * d.y, m.yy + share * d.y * d.y};
    }
    const T of_det = T(1) / (m.xx * m.yy - m.xy * m.xy);
    T size = T(0);
    for (int k = 0; k < kPoints; ++k) {
        const Vec2<T> q = circle[k] + off[k];
        size = gs_max(size, of_det * (m.yy * q.x * q.x - T(2) * m.xy * q.x * q.y + m.xx * q.y * q.y));
    }
    const T grow = T(1.05) * size / h2;
    const T a = l11 * l11, b = l11 * l21, ab = l11 * l22;
    return {mean + center,
            {grow * a * m.xx, grow * (b * m.xx + ab * m.xy),
             grow * (l21 * l21 * m.xx + T(2) * l21 * l22 * m.xy + l22 * l22 * m.yy)}};
}

/// Returns the pixel rectangle in an image whose left and right borders are the same place. A rectangle across them
/// ends beyond width_padded, and stands for all of its tiles, with x modulo the number of tiles in a row.
template <class T>
GS_HD PixelBounds wrapped_bounds(const Vec2<T>& m, const Sym2<T>& cov2d, T threshold, int width, int width_padded,
                                 int height_padded) {
    const T far = T(1e6);
    const T hx = gs_min(gs_sqrt(T(2) * threshold * cov2d.xx), far), hy = gs_sqrt(T(2) * threshold * cov2d.yy);
    const PixelBounds rows = pixel_bounds(m, cov2d, threshold, width_padded, height_padded);
    int x_min = int(gs_floor(m.x - hx)), x_max = int(gs_ceil(m.x + hx));
    const bool over_pole = !(m.y - hy >= T(0) && m.y + hy <= T(height_padded));
    if (over_pole || x_max - x_min >= width) return {width_padded, 2 * width_padded, rows.y_min, rows.y_max};
    if (x_min < 0) x_min += width, x_max += width;
    if (x_max > width)  // the last tile of a row may be cut by the border
        x_max = gs_min(x_max + width_padded - width, x_min / kTileWidth * kTileWidth + width_padded);
    return {x_min, x_max, rows.y_min, rows.y_max};
}

/// Returns the minimum of the power 1/2 d^T Q d over the rectangle of pixel centres [x0+.5, x0+.5+extent_x] x [y0+.5,
/// y0+.5+extent_y], which is 0 if the mean lies inside. P is a scalar, or lanes that test one rectangle each. extent_x
/// and extent_y are positive.
template <class P, class T> GS_HD P min_power_in_rectangle(const Splat<T>& s, P x0, P y0, T extent_x, T extent_y) {
    const P zero(T(0)), one(T(1)), mx(s.mean.x - T(0.5)), my(s.mean.y - T(0.5)), ax(s.a), bx(s.b), cx(s.c),
        wx(extent_x), wy(extent_y);
    const P x1 = x0 + wx, y1 = y0 + wy;
    const P left = select(at_least(x0, mx), one, zero), right = select(at_least(x1, mx), zero, one);
    const P above = select(at_least(y0, my), one, zero), below = select(at_least(y1, my), zero, one);
    const P out_x = left + right, out_y = above + below;
    // The minimum lies on one of the two edges that meet at the corner nearest to the mean (StopThePop).
    const P ex = mx - x1 + left * wx, ey = my - y1 + above * wy;
    const P dx = (left + left - one) * wx, dy = (above + above - one) * wy;
    const P tx = out_y * lane_min(lane_max((ax * ex + bx * ey) * reciprocal(ax * dx), zero), one);
    const P ty = out_x * lane_min(lane_max((bx * ex + cx * ey) * reciprocal(cx * dy), zero), one);
    const P fx = ex - tx * dx, fy = ey - ty * dy;
    const P half(T(0.5));
    return lane_max(out_x, out_y) * (half * (ax * fx * fx + cx * fy * fy) + bx * fx * fy);
}

/// The gradients of the raw geometry.
template <class T> struct GeometryGradient {
    Vec3<T> mean, log_scale;
    Vec4<T> rotation;
    T raw_opacity;
};

/// Returns the gradient of the mean from those of the image point, dm, and of the rows of J W, g1 and g2, for a
/// pinhole.
template <class T>
GS_HD Vec3<T> mean_backward(const CameraParams<T>& cam, const Projection<T>& p, const Vec2<T>& dm, const Vec3<T>& g1,
                            const Vec3<T>& g2) {
    const T dj11 = dot(cam.rotation.r0, g1), dj13 = dot(cam.rotation.r2, g1);
    const T dj22 = dot(cam.rotation.r1, g2), dj23 = dot(cam.rotation.r2, g2);

    // Camera-space mean, through the pixel position and through the Jacobian.
    const T inv_z = T(1) / p.cam.z;
    Vec3<T> dp{p.j11 * dm.x, p.j22 * dm.y, -p.j11 * p.u * dm.x - p.j22 * p.v * dm.y};
    const bool u_inside = p.uc == p.u, v_inside = p.vc == p.v;
    if (u_inside) dp.x = dp.x - p.j11 * dj13 * inv_z;
    if (v_inside) dp.y = dp.y - p.j22 * dj23 * inv_z;
    const T nu = u_inside ? T(2) : T(1), nv = v_inside ? T(2) : T(1);
    dp.z = dp.z + (p.j11 * (nu * p.uc * dj13 - dj11) + p.j22 * (nv * p.vc * dj23 - dj22)) * inv_z;
    return cam.rotation.transposed_times(dp);
}

/// Returns the same through a lens; d.conic holds half of the second moments of the offsets. A change of the mean by r
/// tau in the tangent plane at distance r changes the Jacobian G of the image point there by its second derivatives,
/// and turns the plane.
template <class T>
GS_HD Vec3<T> lens_mean_backward(const CameraParams<T>& cam, const Projection<T>& p, const SplatGradient<T>& d,
                                 const Vec3<T>& g1, const Vec3<T>& g2) {
    const LensPoint<T>& at = p.at;
    const T inverse = T(1) / p.distance;
    T along = T(0), across1 = T(0), across2 = T(0);  // gradient along the axis, and along e1 and e2
    // Offsets are -G y, with y the part of the ray across the axis: they change with G.
    const T of_det = T(2) / p.det, g11 = cam.fx * at.x.x, g12 = cam.fx * at.x.y, g21 = cam.fy * at.y.x,
            g22 = cam.fy * at.y.y, of_g = T(1) / (g11 * g22 - g12 * g21);
    const auto through_offsets = [&](const Jet<T>& j, T focal, T q1, T q2) {  // q: of_det times a row of the adjugate
        const T c1 = d.conic.xx * q1 + d.conic.xy * q2, c2 = d.conic.xy * q1 + d.conic.yy * q2;
        const T t1 = (g22 * c1 - g12 * c2) * of_g, t2 = (g11 * c2 - g21 * c1) * of_g;
        across1 = across1 + focal * (j.xx * t1 + j.xy * t2);
        across2 = across2 + focal * (j.xy * t1 + j.yy * t2);
    };
    through_offsets(at.x, cam.fx, of_det * p.cov2d.yy, -(of_det * p.cov2d.xy));
    through_offsets(at.y, cam.fy, -(of_det * p.cov2d.xy), of_det * p.cov2d.xx);
    const auto add = [&](const Jet<T>& j, T focal, T dm, const Vec3<T>& g) {
        const Vec3<T> q = cam.rotation * g;
        const T q1 = dot(at.e1, q), q2 = dot(at.e2, q), qn = dot(at.axis, q);
        along = along - focal * (j.x * q1 + j.y * q2) * inverse;
        across1 = across1 + focal * (j.x * dm + (j.xx * q1 + j.xy * q2 - j.x * qn) * inverse);
        across2 = across2 + focal * (j.y * dm + (j.xy * q1 + j.yy * q2 - j.y * qn) * inverse);
    };
    add(at.x, cam.fx, d.mean.x, g1);
    add(at.y, cam.fy, d.mean.y, g2);
    return cam.rotation.transposed_times((at.axis * along + at.e1 * across1 + at.e2 * across2) * inverse);
}

/// Computes steps 1 and 3 to 9 of the backward pass: all steps except the colour. `opacity` is that on screen.
template <class T>
GS_HD GeometryGradient<T> project_backward(const GaussianGeometry<T>& g, const CameraParams<T>& cam,
                                           const Projection<T>& p, T opacity, const SplatGradient<T>& d) {
    GeometryGradient<T> out;
    const T dL_dlog_opacity = d.opacity * opacity;
    out.raw_opacity = dL_dlog_opacity * (T(1) - (g.antialiased ? sigmoid(g.raw_opacity) : opacity));

    // Inverse of the 2-D covariance: G2 = -Q Gq Q.
    const T a = p.cov2d.xx, b = p.cov2d.xy, c = p.cov2d.yy, k = T(1) / (p.det * p.det);
    const T ga = d.conic.xx, gb = d.conic.xy, gc = d.conic.yy;
    T g_xx = k * (T(2) * b * c * gb - c * c * ga - b * b * gc);
    T g_xy = k * (b * c * ga - (a * c + b * b) * gb + a * b * gc);
    T g_yy = k * (T(2) * a * b * gb - b * b * ga - a * a * gc);
    if (g.antialiased) {  // the factor of the opacity
        const T without = T(0.5) * dL_dlog_opacity / p.undilated_det, with = T(0.5) * dL_dlog_opacity / p.det;
        g_xx = g_xx + without * (c - T(kAntialiasedDilation)) - with * c;
        g_xy = g_xy + (with - without) * b;
        g_yy = g_yy + without * (a - T(kAntialiasedDilation)) - with * a;
    }

    // World covariance: G3 = A^T G2 A; J W: 2 G2 A Sigma.
    const Vec3<T> q1 = p.a1 * g_xx + p.a2 * g_xy, q2 = p.a1 * g_xy + p.a2 * g_yy;
    const Sym3<T> g3{p.a1.x * q1.x + p.a2.x * q2.x, p.a1.x * q1.y + p.a2.x * q2.y, p.a1.x * q1.z + p.a2.x * q2.z,
                     p.a1.y * q1.y + p.a2.y * q2.y, p.a1.y * q1.z + p.a2.y * q2.z, p.a1.z * q1.z + p.a2.z * q2.z};
    const Vec3<T> g1 = (p.covariance * q1) * T(2), g2 = (p.covariance * q2) * T(2);
    out.mean = cam.lens.is_pinhole() ? mean_backward(cam, p, d.mean, g1, g2) : lens_mean_backward(cam, p, d, g1, g2);

    // Scales: dL/dvar_k = r_k^T G3 r_k with r_k the k-th column of R. Rotation matrix: 2 G3 R diag(var).
    const Mat3<T>& r = p.rotation;
    const Vec3<T> c0{r.r0.x, r.r1.x, r.r2.x}, c1{r.r0.y, r.r1.y, r.r2.y}, c2{r.r0.z, r.r1.z, r.r2.z};
    const Vec3<T> h0 = g3 * c0, h1 = g3 * c1, h2 = g3 * c2;
    const Vec3<T>& var = p.variance;
    out.log_scale = {T(2) * var.x * dot(c0, h0), T(2) * var.y * dot(c1, h1), T(2) * var.z * dot(c2, h2)};
    if (g.antialiased) {  // var includes the 3-D filter
        const auto through_filter = [&](T d, T f2_of_var) { return d + (dL_dlog_opacity - d) * f2_of_var; };
        out.log_scale = {through_filter(out.log_scale.x, g.smoothing / var.x),
                         through_filter(out.log_scale.y, g.smoothing / var.y),
                         through_filter(out.log_scale.z, g.smoothing / var.z)};
    }
    const Vec3<T> m0 = h0 * (T(2) * var.x), m1 = h1 * (T(2) * var.y), m2 = h2 * (T(2) * var.z);

    // Gradient of the unnormalised q.
    const T w = g.rotation.x, x = g.rotation.y, y = g.rotation.z, z = g.rotation.w;
    const T gxx = m1.y + m2.z, gyy = m0.x + m2.z, gzz = m0.x + m1.y;
    const T gxy = m0.y + m1.x, gxz = m2.x + m0.z, gyz = m1.z + m2.y;
    const T grx = m1.z - m2.y, gry = m2.x - m0.z, grz = m0.y - m1.x;
    const T s = T(2) / norm2(g.rotation);
    const T t = s * (x * y * gxy + x * z * gxz + y * z * gyz + w * x * grx + w * y * gry + w * z * grz - x * x * gxx -
                     y * y * gyy - z * z * gzz);
    out.rotation = {s * (x * grx + y * gry + z * grz - w * t),
                    s * (w * grx - T(2) * x * gxx + y * gxy + z * gxz - x * t),
                    s * (w * gry + x * gxy - T(2) * y * gyy + z * gyz - y * t),
                    s * (w * grz + x * gxz + y * gyz - T(2) * z * gzz - z * t)};
    return out;
}

}  // namespace gs
