// SPDX-License-Identifier: Apache-2.0
// The projection of one Gaussian to the image (docs/math/rasterizer.md#projection, #footprint), the exact tile test
// (docs/math/rasterizer.md#tile-test), and the projection's gradient (docs/math/rasterizer.md#projection-gradient).
#pragma once

#include "kernels/base/lanes.h"
#include "kernels/splat/camera.h"
#include "kernels/splat/camera_gradient.h"
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
    Vec3<T> cam;         ///< mean in camera space, through a lens on_face()
    T depth;             ///< depth_of() the mean
    T u, v, uc, vc;      ///< normalised image coordinates, and their values clipped for the Jacobian
    Mat3<T> rotation;    ///< R(q)
    Vec3<T> variance;    ///< exp(2 s), and the 3-D filter
    Sym3<T> covariance;  ///< R diag(variance) R^T, world
    T j11, j22;          ///< fx/z, fy/z
    Vec3<T> a1, a2;      ///< rows of J W
    Sym2<T> cov2d;       ///< with dilation
    T det;
    T undilated_det{}, compensation{};  ///< antialiased only: det without dilation, and the factor of the opacity
    // Through a lens only. All above is then by the pinhole of a face; a1, a2 and cov2d are scaled by `inclination`.
    int face{};         ///< face_of() the mean
    LensPoint<T> at{};  ///< image point of the mean, by u and v
    T inclination{};    ///< cosine of the angle between the mean and the middle of the face; 1 as pinholes
    Sym2<T> dilation{};
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

/// Returns the variance of the dilation of a Gaussian, square pixels on screen.
template <class T> GS_HD T dilation_of(const GaussianGeometry<T>& g) {
    return T(g.antialiased ? kAntialiasedDilation : kDilation);
}

/// Computes the covariance on screen from the rows of J W, and for an antialiased Gaussian the factor of its opacity.
template <class T>
GS_HD void project_covariance(const GaussianGeometry<T>& g, const Sym2<T>& dilation, Projection<T>& p) {
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
    p.cov2d = {dot(p.a1, sa1) + dilation.xx, dot(p.a1, sa2) + dilation.xy, dot(p.a2, sa2) + dilation.yy};
    p.det = p.cov2d.xx * p.cov2d.yy - p.cov2d.xy * p.cov2d.xy;
    if (g.antialiased) {
        const T det = p.undilated_det + dilation.xx * (p.cov2d.yy - dilation.yy) + dilation.yy * p.cov2d.xx -
                      dilation.xy * (T(2) * p.cov2d.xy - dilation.xy);
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
    const T dilation = dilation_of(g);
    project_covariance(g, {dilation, T(0), dilation}, p);
}

/// Returns the rotation from the world to the axes of a face.
template <class T> GS_HD Mat3<T> face_rotation(const Mat3<T>& r, int face) {
    return axis_of(face) == 0 ? r : axis_of(face) == 1 ? Mat3<T>{r.r2, r.r1, r.r0} : Mat3<T>{r.r0, r.r2, r.r1};
}

/// The Jacobian of the image point by the point of a face, pixels by pixels.
template <class T> struct FaceJacobian {
    T xx, xy, yx, yy;

    GS_HD FaceJacobian(const CameraParams<T>& cam, const LensPoint<T>& at) {
        const T fx = cam.fx / cam.face_focal(), fy = cam.fy / cam.face_focal();
        xx = fx * at.x.x, xy = fx * at.x.y, yx = fy * at.y.x, yy = fy * at.y.y;
    }
    GS_HD T det() const { return xx * yy - xy * yx; }
    GS_HD void scale(T k) { xx = xx * k, xy = xy * k, yx = yx * k, yy = yy * k; }
    /// Returns the point of the face whose image is (x, y), as offsets.
    GS_HD Vec2<T> solve(T x, T y) const {
        const T inverse = T(1) / det();
        return {(yy * x - xy * y) * inverse, (xx * y - yx * x) * inverse};
    }
};

/// Finds the image point of the point (u, v) of a face, and its inclination.
template <class T> GS_HD void place_on_face(const CameraParams<T>& cam, int face, T u, T v, Projection<T>& p) {
    p.face = face, p.u = u, p.v = v;
    p.inclination = cam.lens.as_pinholes ? T(1) : T(1) / gs_sqrt(T(1) + u * u + v * v);
    p.at = lens_point_at(cam.lens, face_direction(u, v, face), axis_on_face<T>(0, face), axis_on_face<T>(1, face));
}

/// Computes steps 4 to 8 for the mean in p.cam in the axes of its face. The dilation is round on screen.
template <class T>
GS_HD void project_on_face(const GaussianGeometry<T>& g, const CameraParams<T>& cam, Projection<T>& p) {
    const int face = face_of(p.cam);
    p.cam = on_face(p.cam, face);
    const T inv_z = T(1) / p.cam.z;
    place_on_face(cam, face, p.cam.x * inv_z, p.cam.y * inv_z, p);
    p.uc = p.u, p.vc = p.v;
    p.j11 = p.j22 = cam.face_focal() * inv_z;
    const Mat3<T> r = face_rotation(cam.rotation, face);
    p.a1 = (r.r0 - r.r2 * p.u) * (p.j11 * p.inclination);
    p.a2 = (r.r1 - r.r2 * p.v) * (p.j22 * p.inclination);
    const FaceJacobian<T> jacobian(cam, p.at);
    const Vec2<T> x = jacobian.solve(T(1), T(0)), y = jacobian.solve(T(0), T(1));
    const T d = dilation_of(g) * p.inclination * p.inclination;
    p.dilation = {d * (x.x * x.x + y.x * y.x), d * (x.x * x.y + y.x * y.y), d * (x.y * x.y + y.y * y.y)};
    project_covariance(g, p.dilation, p);
}

/// Transforms a mean to the camera's frame: step 2 of the forward pass.
template <class T> GS_HD Vec3<T> camera_point(const Vec3<T>& mean, const CameraParams<T>& cam) {
    return cam.rotation * mean + cam.translation;
}

/// Returns the depth of a point in camera space, which orders blending: the camera's z, or with a lens the distance or
/// the largest coordinate.
template <class T> GS_HD T depth_of(const Vec3<T>& point, const CameraParams<T>& cam) {
    if (cam.lens.is_pinhole()) return point.z;
    if (!cam.lens.as_pinholes) return gs_sqrt(dot(point, point));
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
        if (!cam.lens.reaches(p.cam, gs_sqrt(dot(p.cam, p.cam)))) return false;
        project_on_face(g, cam, p);
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
    bool wide;  ///< as in LensShape
};

/// Returns an ellipse that holds all pixels which a splat through a lens may reach: those whose power is at most
/// `threshold`, as the level set of this power. `mean` is the image point of the mean. Reads what place_on_face() sets,
/// cov2d and det.
template <class T>
GS_HD Outline<T> lens_outline(const CameraParams<T>& cam, const Projection<T>& p, const Vec2<T>& mean, T threshold) {
    constexpr double kPi = 3.14159265358979323846;
    // The largest extent, as the sine of an angle, or as by pinholes on the face. Offsets from a unit ray that differ
    // along the mean belong to a smaller angle.
    const T unit = T(1) / cam.face_focal(), h2 = T(2) * threshold, off2 = p.u * p.u + p.v * p.v;
    const Sym2<T>& c = p.cov2d;
    const bool as_pinholes = cam.lens.as_pinholes;
    const T along =
        as_pinholes ? T(0)
                    : (p.u * p.u * c.xx + T(2) * p.u * p.v * c.xy + p.v * p.v * c.yy) * p.inclination * p.inclination;
    const T trace = T(0.5) * (c.xx + c.yy - along);
    const T rho2 = h2 * unit * unit *
                   (trace + gs_sqrt(gs_max(trace * trace - p.det * p.inclination * p.inclination, T(0)))),
            rho = gs_sqrt(rho2);
    if (!(rho < T(as_pinholes ? kMostFaceExtent : kMostLensExtent)))
        return {mean, {T(kMaxVariance2d), T(0), T(kMaxVariance2d)}, true};
    // A small splat is narrow if pixels that are blended together lie within a radian. The scale is at least 0.4 f.
    constexpr double kFewestPixels = 1.5 * kTileWidth / 0.4;
    const bool wide = rho > T(0.5) || cam.face_focal() < T(kFewestPixels) ||
                      cam.fy * (cam.lens.wraps() ? T(1 / kPi) : T(1)) < T(kFewestPixels);
    // Near the poles of a 360-degree image the outline is a band of rows.
    if (cam.lens.wraps()) {
        const T far2 = off2 + T(1), far = gs_sqrt(far2), ahead = far2 - rho * gs_sqrt(off2);
        const T height = face_direction(p.u, p.v, p.face).y / far;
        const T angle = as_pinholes ? gs_atan2(rho * far, ahead) : gs_atan2(rho, gs_sqrt(T(1) - rho2));
        const T sine = !as_pinholes ? rho : ahead > T(0) ? rho * far / gs_sqrt(rho2 * far2 + ahead * ahead) : T(1);
        if (sine > T(0.7) * gs_sqrt(gs_max(T(1) - height * height, T(0)))) {
            const T rows = angle * cam.fy * T(1 / kPi);
            return {mean, {T(kMaxVariance2d), T(0), rows * rows / h2}, true};
        }
    }
    // Offsets on the face are those from a unit ray divided by the inclination, to first order.
    FaceJacobian<T> g(cam, p.at);
    g.scale(T(1) / p.inclination);
    const Vec2<T> row1{g.xx * c.xx + g.xy * c.xy, g.xx * c.xy + g.xy * c.yy},
        row2{g.yx * c.xx + g.yy * c.xy, g.yx * c.xy + g.yy * c.yy};
    const Sym2<T> s{row1.x * g.xx + row1.y * g.xy, row1.x * g.yx + row1.y * g.yy, row2.x * g.yx + row2.y * g.yy};
    const auto norm2 = [](const Jet<T>& j, T focal) {
        return focal * focal * (j.xx * j.xx + T(2) * j.xy * j.xy + j.yy * j.yy);
    };
    // The image point is off its linear continuation by half the second derivatives, and by terms of the third order.
    const T on_face = T(1) / (p.inclination * p.inclination),
            size_g = cam.face_focal() * gs_sqrt(g.xx * g.xx + g.xy * g.xy + g.yx * g.yx + g.yy * g.yy);
    const T bend = T(0.65) * gs_sqrt(norm2(p.at.x, cam.fx) + norm2(p.at.y, cam.fy)) * on_face * on_face * rho2 +
                   size_g * ((as_pinholes ? T(0) : T(1.3) * gs_sqrt(off2) * on_face) + T(2) * rho) * rho2;
    const T half = T(0.5) * (s.xx + s.yy), apart = T(0.5) * (s.xx - s.yy);
    const T least = gs_max(half - gs_sqrt(apart * apart + s.xy * s.xy), T(kMinDeterminant));
    const T ratio = bend / gs_sqrt(h2 * least);
    if (ratio < T(0.05)) {
        // The ellipse sqrt(h2 S) and a disc of radius `bend`, added up, lie in this multiple of the ellipse.
        const T grow = (T(1) + ratio) * (T(1) + ratio);
        return {mean, {grow * s.xx, grow * s.xy, grow * s.yy}, wide};
    }
    // Points of a circle that L = chol(h2 S) maps to the ellipse, and the offsets of the contour from it.
    constexpr int kPoints = 24;
    const T turn_cosine = T(0.96592582628906829), turn_sine = T(0.25881904510252076);
    const T l11 = gs_sqrt(h2 * s.xx), l21 = h2 * s.xy / l11, l22 = gs_abs(g.det()) * gs_sqrt(h2 * p.det / s.xx);
    Vec2<T> circle[kPoints], off[kPoints], center{T(0), T(0)};
    for (int k = 0; k < kPoints; ++k) {
        const Vec2<T> u = k == 0 ? Vec2<T>{T(1), T(0)}
                                 : Vec2<T>{turn_cosine * circle[k - 1].x - turn_sine * circle[k - 1].y,
                                           turn_sine * circle[k - 1].x + turn_cosine * circle[k - 1].y};
        const Vec2<T> e{l11 * u.x, l21 * u.x + l22 * u.y};
        const Vec2<T> d = g.solve(e.x, e.y) * unit;
        T w = T(1);  // along the axis of the face
        if (!as_pinholes) {
            const T b = p.u * d.x + p.v * d.y, k = p.inclination * p.inclination;
            w = k * (gs_sqrt(gs_max(b * b + (T(1) - d.x * d.x - d.y * d.y) / k, T(0))) - b);
        }
        const T sign(sign_of(p.face));
        const Vec2<T> at = lens_point(
            cam.lens, gs::on_face(Vec3<T>{(p.u * w + d.x) * sign, (p.v * w + d.y) * sign, w * sign}, p.face));
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
    const auto size_at = [&](int k) {
        const Vec2<T> q = circle[k] + off[k];
        return of_det * (m.yy * q.x * q.x - T(2) * m.xy * q.x * q.y + m.xx * q.y * q.y);
    };
    T size = T(0), between = T(0), before = size_at(kPoints - 2), last = size_at(kPoints - 1);
    for (int k = 0; k < kPoints; ++k) {
        const T next = size_at(k);
        size = gs_max(size, next), between = gs_max(between, gs_abs(before - T(2) * last + next));
        before = last, last = next;
    }
    const T grow = (T(1.01) * size + T(0.25) * between) / h2;
    const T a = l11 * l11, b = l11 * l21, ab = l11 * l22;
    return {mean + center,
            {grow * a * m.xx, grow * (b * m.xx + ab * m.xy),
             grow * (l21 * l21 * m.xx + T(2) * l21 * l22 * m.xy + l22 * l22 * m.yy)},
            wide};
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

/// The gradients of the raw geometry, and its part of the camera's.
template <class T> struct GeometryGradient {
    Vec3<T> mean, log_scale;
    Vec4<T> rotation;
    T raw_opacity;
    CameraGradient<T> camera;  ///< 0 if it was not requested; without the position, whose gradient is -mean
};

/// Returns the gradient of the mean from those of the image point, dm, and of the rows of J W, g1 and g2. `rotation` is
/// that of the pinhole.
template <class T>
GS_HD Vec3<T> mean_backward(const Mat3<T>& rotation, const Projection<T>& p, const Vec2<T>& dm, const Vec3<T>& g1,
                            const Vec3<T>& g2) {
    const T dj11 = dot(rotation.r0, g1), dj13 = dot(rotation.r2, g1);
    const T dj22 = dot(rotation.r1, g2), dj23 = dot(rotation.r2, g2);

    // Camera-space mean, through the pixel position and through the Jacobian.
    const T inv_z = T(1) / p.cam.z;
    Vec3<T> dp{p.j11 * dm.x, p.j22 * dm.y, -p.j11 * p.u * dm.x - p.j22 * p.v * dm.y};
    const bool u_inside = p.uc == p.u, v_inside = p.vc == p.v;
    if (u_inside) dp.x = dp.x - p.j11 * dj13 * inv_z;
    if (v_inside) dp.y = dp.y - p.j22 * dj23 * inv_z;
    const T nu = u_inside ? T(2) : T(1), nv = v_inside ? T(2) : T(1);
    dp.z = dp.z + (p.j11 * (nu * p.uc * dj13 - dj11) + p.j22 * (nv * p.vc * dj23 - dj22)) * inv_z;
    return rotation.transposed_times(dp);
}

/// Returns the gradient of the point of a mean on its face by way of the dilation, pixels of the face; d is its
/// variance on screen times the square of the inclination, and g its gradient. With the Jacobian G of the image point,
/// the dilation d (G^T G)^-1 changes with G.
template <class T>
GS_HD Vec2<T> dilation_backward(const CameraParams<T>& cam, const Projection<T>& p, T d, const Sym2<T>& g) {
    const Sym2<T>& m = p.dilation;
    const T xx = m.xx * g.xx + m.xy * g.xy, xy = m.xx * g.xy + m.xy * g.yy, yx = m.xy * g.xx + m.yy * g.xy,
            yy = m.xy * g.xy + m.yy * g.yy;
    const Sym2<T> k{xx * m.xx + xy * m.xy, xx * m.xy + xy * m.yy, yx * m.xy + yy * m.yy};
    const T unit = T(1) / cam.face_focal(), scale = T(-2) / d * unit * unit * unit;
    Vec2<T> out{T(0), T(0)};
    const auto add = [&](const Jet<T>& j, T focal) {
        const T tx = k.xx * j.x + k.xy * j.y, ty = k.xy * j.x + k.yy * j.y, s = scale * focal * focal;
        out = out + Vec2<T>{s * (tx * j.xx + ty * j.xy), s * (tx * j.xy + ty * j.yy)};
    };
    add(p.at.x, cam.fx);
    add(p.at.y, cam.fy);
    return out;
}

/// Returns the gradient of the mean on screen, for the densification statistic, from that on its face.
template <class T>
GS_HD Vec2<T> mean_on_screen_backward(const CameraParams<T>& cam, const Projection<T>& p, const Vec2<T>& dm) {
    if (cam.lens.is_pinhole()) return dm;
    const FaceJacobian<T> g(cam, p.at);
    const T inverse = T(1) / g.det();
    return {(g.yy * dm.x - g.yx * dm.y) * inverse, (g.xx * dm.y - g.xy * dm.x) * inverse};
}

/// Returns a Gaussian's part of the gradient of the camera, except by its position
/// (docs/math/rasterizer.md#camera-gradient). `offset` is the mean relative to the camera's centre, and d_offset the
/// gradient of the offset, both in world axes; dm the gradient of the point on the face, without the dilation's part;
/// g1 and g2 those of the rows a1 and a2.
template <class T>
GS_HD CameraGradient<T> camera_backward(const CameraParams<T>& cam, const Projection<T>& p, const Vec3<T>& offset,
                                        const Vec3<T>& d_offset, const Vec2<T>& dm, const Vec3<T>& g1,
                                        const Vec3<T>& g2) {
    CameraGradient<T> out{};
    out.rotation = cross(offset, d_offset) + cross(g1, p.a1) + cross(g2, p.a2);
    const Vec2<T> on_screen = mean_on_screen_backward(cam, p, dm);
    out.cx = on_screen.x, out.cy = on_screen.y;
    // The rows change among themselves by H = G^-1 dG, where G is the Jacobian of the image point by the point of the
    // face: by sum_ij H_ij n_ji.
    const T n11 = dot(p.a1, g1), n22 = dot(p.a2, g2);
    if (cam.lens.is_pinhole()) {
        out.fx = p.u * dm.x + n11 / cam.fx;
        out.fy = p.v * dm.y + n22 / cam.fy;
        // Beyond the edge of the image the clip of u and v moves with it.
        if (p.uc != p.u) {
            const T d_uc = p.j11 * dot(cam.rotation.r2, g1) / cam.fx;
            out.fx = out.fx + p.uc * d_uc, out.cx = out.cx + d_uc;
        }
        if (p.vc != p.v) {
            const T d_vc = p.j22 * dot(cam.rotation.r2, g2) / cam.fy;
            out.fy = out.fy + p.vc * d_vc, out.cy = out.cy + d_vc;
        }
        return out;
    }
    const T n12 = dot(p.a1, g2), n21 = dot(p.a2, g1);
    const FaceJacobian<T> g(cam, p.at);
    const T inverse = T(1) / g.det();
    const auto by_row_x = [&](T xx, T xy) {
        return ((xx * n11 + xy * n21) * g.yy - (xx * n12 + xy * n22) * g.yx) * inverse;
    };
    const auto by_row_y = [&](T yx, T yy) {
        return ((yx * n12 + yy * n22) * g.xx - (yx * n11 + yy * n21) * g.xy) * inverse;
    };
    out.fx = on_screen.x * p.at.x.value + by_row_x(g.xx, g.xy) / cam.fx;
    out.fy = on_screen.y * p.at.y.value + by_row_y(g.yx, g.yy) / cam.fy;
    const LensPoint<T> by = lens_point_by_coefficient(cam.lens, face_direction(p.u, p.v, p.face),
                                                      axis_on_face<T>(0, p.face), axis_on_face<T>(1, p.face));
    const FaceJacobian<T> h(cam, by);
    out.distortion = on_screen.x * cam.fx * by.x.value + on_screen.y * cam.fy * by.y.value + by_row_x(h.xx, h.xy) +
                     by_row_y(h.yx, h.yy);
    return out;
}

/// Computes steps 1 and 3 to 9 of the backward pass: all steps except the colour. `opacity` is that on screen.
/// Also computes the gradient of the camera if `with_camera` is set.
template <class T>
GS_HD GeometryGradient<T> project_backward(const GaussianGeometry<T>& g, const CameraParams<T>& cam,
                                           const Projection<T>& p, T opacity, const SplatGradient<T>& d,
                                           bool with_camera) {
    GeometryGradient<T> out;
    const T dL_dlog_opacity = d.opacity * opacity;
    out.raw_opacity = dL_dlog_opacity * (T(1) - (g.antialiased ? sigmoid(g.raw_opacity) : opacity));

    // Inverse of the 2-D covariance: G2 = -Q Gq Q.
    const T a = p.cov2d.xx, b = p.cov2d.xy, c = p.cov2d.yy, k = T(1) / (p.det * p.det);
    const T ga = d.conic.xx, gb = d.conic.xy, gc = d.conic.yy;
    T g_xx = k * (T(2) * b * c * gb - c * c * ga - b * b * gc);
    T g_xy = k * (b * c * ga - (a * c + b * b) * gb + a * b * gc);
    T g_yy = k * (T(2) * a * b * gb - b * b * ga - a * a * gc);
    if (g.antialiased) {  // the factor of the opacity, by the dilated covariance
        const T with = T(0.5) * dL_dlog_opacity / p.det;
        g_xx = g_xx - with * c, g_xy = g_xy + with * b, g_yy = g_yy - with * a;
    }
    const bool pinhole = cam.lens.is_pinhole();
    Vec2<T> dm = d.mean;
    T k_inclination = T(1), d_inclination = T(0);
    if (!pinhole) {
        k_inclination = p.inclination;
        dm = dm + dilation_backward(cam, p, dilation_of(g) * k_inclination * k_inclination, {g_xx, g_xy, g_yy});
        d_inclination = T(2) * (g_xx * p.dilation.xx + T(2) * g_xy * p.dilation.xy + g_yy * p.dilation.yy);
    }
    if (g.antialiased) {  // and by that without dilation
        const T without = T(0.5) * dL_dlog_opacity / p.undilated_det, dilation = T(kAntialiasedDilation);
        const Sym2<T> m = pinhole ? Sym2<T>{dilation, T(0), dilation} : p.dilation;
        g_xx = g_xx + without * (c - m.yy), g_xy = g_xy - without * (b - m.xy), g_yy = g_yy + without * (a - m.xx);
    }

    // World covariance: G3 = A^T G2 A; J W: 2 G2 A Sigma.
    const Vec3<T> q1 = p.a1 * g_xx + p.a2 * g_xy, q2 = p.a1 * g_xy + p.a2 * g_yy;
    const Sym3<T> g3{p.a1.x * q1.x + p.a2.x * q2.x, p.a1.x * q1.y + p.a2.x * q2.y, p.a1.x * q1.z + p.a2.x * q2.z,
                     p.a1.y * q1.y + p.a2.y * q2.y, p.a1.y * q1.z + p.a2.y * q2.z, p.a1.z * q1.z + p.a2.z * q2.z};
    const Vec3<T> g1 = (p.covariance * q1) * T(2), g2 = (p.covariance * q2) * T(2);
    if (pinhole) {
        out.mean = mean_backward(cam.rotation, p, dm, g1, g2);
    } else {
        if (!cam.lens.as_pinholes) {  // inclination = (1 + u^2 + v^2)^(-1/2)
            d_inclination = d_inclination + dot(p.a1, g1) + dot(p.a2, g2);
            const T to_uv = -(d_inclination * k_inclination * k_inclination / cam.face_focal());
            dm = dm + Vec2<T>{p.u * to_uv, p.v * to_uv};
        }
        out.mean = mean_backward(face_rotation(cam.rotation, p.face), p, dm, g1 * k_inclination, g2 * k_inclination);
    }
    out.camera =
        with_camera ? camera_backward(cam, p, g.mean - cam.position, out.mean, d.mean, g1, g2) : CameraGradient<T>{};

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
