// SPDX-License-Identifier: Apache-2.0
// The lens models of COLMAP: the image point of a direction (docs/math/rasterizer.md#lenses).
#pragma once

#include "kernels/base/lanes.h"
#include "kernels/base/vec.h"
#include "kernels/splat/jet_device.h"
#include "kernels/splat/raster_config.h"

namespace gs {

/// The lens models of COLMAP, numbered as in cameras.bin.
enum class CameraModel : int {
    kSimplePinhole = 0,
    kPinhole = 1,
    kSimpleRadial = 2,
    kRadial = 3,
    kOpenCV = 4,
    kOpenCVFisheye = 5,
    kFullOpenCV = 6,
    kFov = 7,
    kSimpleRadialFisheye = 8,
    kRadialFisheye = 9,
    kThinPrismFisheye = 10,
    kRadTanThinPrismFisheye = 11,
    kSimpleDivision = 12,
    kDivision = 13,
    kSimpleFisheye = 14,
    kFisheye = 15,
    kEucm = 16,
    kEquirectangular = 17,
};

/// Returns whether a model distorts the angle to the axis, not its tangent, by a polynomial.
GS_HD bool is_fisheye(CameraModel m) {
    return m == CameraModel::kOpenCVFisheye ||
           (m >= CameraModel::kSimpleRadialFisheye && m <= CameraModel::kRadTanThinPrismFisheye) ||
           m == CameraModel::kSimpleFisheye || m == CameraModel::kFisheye;
}

/// A lens in front of a camera. A pinhole has none: its other fields are unused.
template <class T> struct Lens {
    CameraModel model = CameraModel::kPinhole;
    /// Coefficients in COLMAP's order; unused ones are 0. FOV has its angle omega >= 0 and then 2 tan(omega / 2).
    T distortion[12] = {};
    /// The largest angle to the axis at which the lens is used, radians. Beyond it the image point moves outwards by
    /// `slope` (normalised image coordinates per radian), since the polynomials fold back there.
    T max_angle = {}, slope = {};
    T sin_max = {}, cos_max = {};  ///< of max_angle
    T cos_drawn = {};              ///< cosine of the largest angle at which the mean of a Gaussian is drawn
    /// Whether Gaussians are drawn and ordered as by six pinhole cameras that look along the axes and against them, not
    /// each as by one that looks at its mean, and by distance.
    bool as_pinholes = false;

    GS_HD bool is_pinhole() const { return model <= CameraModel::kPinhole; }
    /// Returns whether the left and the right border of the image are the same place.
    GS_HD bool wraps() const { return model == CameraModel::kEquirectangular; }
    /// Returns whether a Gaussian at a point of camera space is drawn: those too far beyond the edge of the image are
    /// not.
    GS_HD bool reaches(const Vec3<T>& point, T distance) const { return wraps() || point.z >= cos_drawn * distance; }
};

/// Returns the sum of k[i] s^(i+1).
template <class T, class S> GS_HD S power_series(const T* k, int count, const S& s) {
    S sum = s * k[count - 1];
    for (int i = count - 1; i-- > 0;) sum = (sum + k[i]) * s;
    return sum;
}

/// Distorts a point (x, y) of the image plane of a pinhole or of an equidistant lens by COLMAP's polynomial models.
template <class T, class S> GS_HD Vec2<S> distort_plane(const Lens<T>& lens, const S& x, const S& y) {
    using M = CameraModel;
    const T* const d = lens.distortion;
    const S s = x * x + y * y;
    S radial = s * T(0);
    const auto one_plus = [](const S& a) { return a + T(1); };
    const auto with_tangential = [](const S& u, const S& v, const S& rho2, T p1, T p2, const Vec2<S>& to) {
        const S uv = u * v;
        return Vec2<S>{to.x + uv * (T(2) * p1) + (rho2 + u * u * T(2)) * p2,
                       to.y + uv * (T(2) * p2) + (rho2 + v * v * T(2)) * p1};
    };
    switch (lens.model) {
        case M::kSimpleRadial:
        case M::kSimpleRadialFisheye:
            radial = power_series(d, 1, s);
            break;
        case M::kRadial:
        case M::kRadialFisheye:
        case M::kOpenCV:
            radial = power_series(d, 2, s);
            break;
        case M::kOpenCVFisheye:
            radial = power_series(d, 4, s);
            break;
        case M::kFullOpenCV: {
            const T numerator[3] = {d[0], d[1], d[4]};
            radial = one_plus(power_series(numerator, 3, s)) * gs_inverse(one_plus(power_series(d + 5, 3, s))) + T(-1);
            break;
        }
        case M::kThinPrismFisheye: {
            const T k[4] = {d[0], d[1], d[4], d[5]};
            radial = power_series(k, 4, s);
            break;
        }
        case M::kRadTanThinPrismFisheye:
            radial = power_series(d, 6, s);
            break;
        default:
            break;
    }
    const Vec2<S> out{x * one_plus(radial), y * one_plus(radial)};
    switch (lens.model) {
        case M::kOpenCV:
        case M::kFullOpenCV:
            return with_tangential(x, y, s, d[2], d[3], out);
        case M::kThinPrismFisheye: {
            const Vec2<S> p = with_tangential(x, y, s, d[2], d[3], out);
            return {p.x + s * d[6], p.y + s * d[7]};
        }
        case M::kRadTanThinPrismFisheye: {
            const S rho2 = out.x * out.x + out.y * out.y;
            const Vec2<S> p = with_tangential(out.x, out.y, rho2, d[7], d[6], out);
            return {p.x + (rho2 * d[9] + d[8]) * rho2, p.y + (rho2 * d[11] + d[10]) * rho2};
        }
        default:
            return out;
    }
}

/// Returns atan2(rho, z) / rho for rho2 = rho^2, also where rho is 0 and z > 0.
template <class T, class S> GS_HD S angle_over(const S& rho2, const S& z) {
    if (value_of(z) > T(0) && value_of(rho2) < T(0.01) * (value_of(z) * value_of(z))) {
        const S over_z = gs_inverse(z), q = rho2 * over_z * over_z;
        const T series[6] = {T(-1.0 / 3), T(1.0 / 5), T(-1.0 / 7), T(1.0 / 9), T(-1.0 / 11), T(1.0 / 13)};
        return (power_series(series, 6, q) + T(1)) * over_z;
    }
    const S rho = gs_sqrt(rho2);
    return gs_atan2(rho, z) * gs_inverse(rho);
}

/// Returns the image point, in normalised image coordinates, of a direction within the angle at which the lens is used.
/// The direction may have any length.
template <class T, class S> GS_HD Vec2<S> distort_direction(const Lens<T>& lens, const Vec3<S>& d) {
    using M = CameraModel;
    constexpr double kPi = 3.14159265358979323846;
    const T* const k = lens.distortion;
    const S rho2 = d.x * d.x + d.y * d.y;
    if (is_fisheye(lens.model)) {
        const S factor = angle_over<T>(rho2, d.z);
        return distort_plane(lens, S(d.x * factor), S(d.y * factor));
    }
    switch (lens.model) {
        case M::kFov: {
            if (!(k[0] > T(0))) break;
            const S factor = angle_over<T>(S(rho2 * (k[1] * k[1])), d.z) * (k[1] / k[0]);
            return {d.x * factor, d.y * factor};
        }
        case M::kSimpleDivision:
        case M::kDivision: {
            const S factor = gs_inverse(d.z + gs_sqrt(d.z * d.z - rho2 * (T(4) * k[0]))) * T(2);
            return {d.x * factor, d.y * factor};
        }
        case M::kEucm: {
            const S factor = gs_inverse(gs_sqrt(rho2 * k[1] + d.z * d.z) * k[0] + d.z * (T(1) - k[0]));
            return {d.x * factor, d.y * factor};
        }
        case M::kEquirectangular:
            return {gs_atan2(d.x, d.z) * T(0.5 / kPi) + T(0.5),
                    gs_atan2(d.y, gs_sqrt(d.x * d.x + d.z * d.z)) * T(1 / kPi) + T(0.5)};
        default:
            break;
    }
    const S over_z = gs_inverse(d.z);
    return distort_plane(lens, S(d.x * over_z), S(d.y * over_z));
}

/// Returns the image point of any direction, in normalised image coordinates: that of the lens up to max_angle, and its
/// linear continuation beyond.
template <class T, class S> GS_HD Vec2<S> lens_point(const Lens<T>& lens, const Vec3<S>& d) {
    const T z = value_of(d.z);
    const T norm2 = value_of(d.x) * value_of(d.x) + value_of(d.y) * value_of(d.y) + z * z;
    if (lens.wraps() || z >= gs_sqrt(norm2) * lens.cos_max) return distort_direction(lens, d);
    const S rho = gs_sqrt(d.x * d.x + d.y * d.y), inverse = gs_inverse(rho);
    const S ux = d.x * inverse, uy = d.y * inverse;
    const Vec2<S> edge =
        distort_direction(lens, Vec3<S>{ux * lens.sin_max, uy * lens.sin_max, rho * T(0) + lens.cos_max});
    const S beyond = (gs_atan2(rho, d.z) + (-lens.max_angle)) * lens.slope;
    return {edge.x + ux * beyond, edge.y + uy * beyond};
}

// The faces of the cube around the camera are the images of six pinhole cameras. A Gaussian through a lens has its
// coordinates on the face that the direction of its mean passes, whether it is drawn as that pinhole does or not. The
// faces before the camera, to its right and below it are 0, 1 and 2, and those opposite 3, 4 and 5.
inline constexpr int kFaceAxes = 3;

/// Returns which of the camera's axes, z, x or y, passes through the middle of a face, and its sign there.
GS_HD int axis_of(int face) { return face % kFaceAxes; }
GS_HD int sign_of(int face) { return face < kFaceAxes ? 1 : -1; }

/// Returns the face that a direction passes.
template <class T> GS_HD int face_of(const Vec3<T>& d) {
    const T x = gs_abs(d.x), y = gs_abs(d.y), z = gs_abs(d.z);
    const int axis = z >= x && z >= y ? 0 : x >= y ? 1 : 2;
    return axis + (axis == 0 ? d.z < T(0) : axis == 1 ? d.x < T(0) : d.y < T(0)) * kFaceAxes;
}

/// Returns a vector in the axes of a face, the one through its middle last, or such a vector in the camera's axes. The
/// last coordinate is negative on the faces 3 to 5.
template <class T> GS_HD Vec3<T> on_face(const Vec3<T>& d, int face) {
    return axis_of(face) == 0 ? d : axis_of(face) == 1 ? Vec3<T>{d.z, d.y, d.x} : Vec3<T>{d.x, d.z, d.y};
}

/// Returns the direction of the point (u, v) of a face, which is the middle plus u and v in units of its distance. On
/// the faces 3 to 5, u and v point against the axes: they are quotients by the last coordinate of on_face().
template <class T> GS_HD Vec3<T> face_direction(T u, T v, int face) {
    const T sign(sign_of(face));
    return on_face(Vec3<T>{u * sign, v * sign, sign}, face);
}

/// Returns the derivative of face_direction() by u (0) or v (1).
template <class T> GS_HD Vec3<T> axis_on_face(int axis, int face) {
    const T sign(sign_of(face));
    return on_face(axis == 0 ? Vec3<T>{sign, T(0), T(0)} : Vec3<T>{T(0), sign, T(0)}, face);
}

/// The ray of a pixel in the axes of a face, in units in which the middle of the face is one focal length away.
template <class P> struct FaceRay {
    P x, y, w;  ///< pixels, and along the axis through the middle
};

/// Returns a unit ray in the axes of a face and of the face opposite. With `as_pinholes` it is as long as the way to
/// the face, but at most 1000 times as long as the ray.
template <class P, class T> GS_HD FaceRay<P> face_ray(const Vec3<P>& ray, int face, T focal, bool as_pinholes) {
    const Vec3<P> d = on_face(ray, face);
    const P length = as_pinholes ? reciprocal(lane_max(lane_max(d.z, P(T(0)) - d.z), P(T(1e-3)))) : P(T(1));
    return {d.x * (P(focal) * length), d.y * (P(focal) * length), d.z * length};
}

/// The image point of a direction and its derivatives.
template <class T> struct LensPoint {
    Jet<T> x, y;  ///< normalised image coordinates of direction + a e1 + b e2 by (a, b)
};

/// Returns two unit vectors that form an orthonormal right-handed system with the unit vector n (Duff et al. 2017).
template <class T> GS_HD void tangent_basis(const Vec3<T>& n, Vec3<T>& e1, Vec3<T>& e2) {
    const T sign = n.z >= T(0) ? T(1) : T(-1), a = T(-1) / (sign + n.z), b = n.x * n.y * a;
    e1 = {T(1) + sign * n.x * n.x * a, sign * b, -(sign * n.x)};
    e2 = {b, sign + n.y * n.y * a, -n.y};
}

/// Returns the image point of a direction, which must not be 0, with its derivatives along e1 and e2. The arguments are
/// values, because the device would copy a kernel's parameters to memory to pass a reference to them.
template <class T> GS_NOINLINE LensPoint<T> lens_point_at(Lens<T> lens, Vec3<T> direction, Vec3<T> e1, Vec3<T> e2) {
    using J = Jet<T>;
    const Vec2<J> at = lens_point(lens, Vec3<J>{J::linear(direction.x, e1.x, e2.x), J::linear(direction.y, e1.y, e2.y),
                                                J::linear(direction.z, e1.z, e2.z)});
    return {at.x, at.y};
}

/// Returns a lens with another first coefficient, and the same range.
template <class T> GS_HD Lens<T> with_first_coefficient(Lens<T> lens, T value) {
    lens.distortion[0] = value;
    if (lens.model == CameraModel::kFov) {
        T s, c;
        gs_sincos(T(0.5) * value, s, c);
        lens.distortion[1] = T(2) * s / c;
    }
    return lens;
}

/// Returns the derivative of lens_point_at() by the first coefficient of distortion, without second derivatives. It is
/// 0 for models without distortion.
template <class T>
GS_NOINLINE LensPoint<T> lens_point_by_coefficient(Lens<T> lens, Vec3<T> direction, Vec3<T> e1, Vec3<T> e2) {
    // A difference is exact for the models that are linear in the coefficient, and close for the others.
    const T step(0.01);
    const auto at = [&](T coefficient) {
        using J = Jet<T>;
        return lens_point(with_first_coefficient(lens, coefficient),
                          Vec3<J>{J::linear(direction.x, e1.x, e2.x), J::linear(direction.y, e1.y, e2.y),
                                  J::linear(direction.z, e1.z, e2.z)});
    };
    const Vec2<Jet<T>> more = at(lens.distortion[0] + step), less = at(lens.distortion[0] - step);
    const auto slope = [inverse = T(0.5) / step](const Jet<T>& a, const Jet<T>& b) {
        return Jet<T>{(a.value - b.value) * inverse, (a.x - b.x) * inverse, (a.y - b.y) * inverse, T(0), T(0), T(0)};
    };
    return {slope(more.x, less.x), slope(more.y, less.y)};
}

/// Returns the unit direction whose image point is (x, y), in normalised image coordinates, by Newton's method on the
/// sphere.
template <class T> GS_HD Vec3<T> lens_ray(const Lens<T>& lens, T x, T y) {
    constexpr double kPi = 3.14159265358979323846;
    if (lens.wraps()) {
        T sa, ca, sb, cb;
        gs_sincos((x - T(0.5)) * T(2 * kPi), sa, ca);
        gs_sincos((y - T(0.5)) * T(kPi), sb, cb);
        return {cb * sa, sb, cb * ca};
    }
    const T radius = gs_sqrt(x * x + y * y);
    T s, c;
    gs_sincos(gs_min(radius, T(0.9) * lens.max_angle), s, c);
    const T side = radius > T(0) ? s / radius : T(0);
    Vec3<T> d{x * side, y * side, c};
    for (int i = 0; i < 12; ++i) {
        Vec3<T> e1, e2;
        tangent_basis(d, e1, e2);
        const LensPoint<T> at = lens_point_at(lens, d, e1, e2);
        const T dx = x - at.x.value, dy = y - at.y.value;
        const T inverse = T(1) / (at.x.x * at.y.y - at.x.y * at.y.x);
        T a = (at.y.y * dx - at.x.y * dy) * inverse, b = (at.x.x * dy - at.y.x * dx) * inverse;
        const T step2 = a * a + b * b;
        if (!(step2 < T(1e30))) break;
        if (step2 > T(0.09)) {
            const T shorter = T(0.3) / gs_sqrt(step2);
            a = a * shorter, b = b * shorter;
        }
        d = d + e1 * a + e2 * b;
        d = d * (T(1) / gs_sqrt(dot(d, d)));
        if (step2 < T(sizeof(T) == 4 ? 1e-13 : 1e-26)) break;
    }
    return d;
}

}  // namespace gs
