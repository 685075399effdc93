// SPDX-License-Identifier: Apache-2.0
// The lens models of COLMAP: their names, their parameters and their projection in both directions, in double.
#include "lib/scene/camera_models.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/AutoDiff>

namespace gs {
namespace {

using Eigen::Vector2d, Eigen::Vector3d;
using M = CameraModel;

constexpr CameraModelInfo kModels[] = {
    {M::kSimplePinhole, "SIMPLE_PINHOLE", 1, 0},
    {M::kPinhole, "PINHOLE", 2, 0},
    {M::kSimpleRadial, "SIMPLE_RADIAL", 1, 1},
    {M::kRadial, "RADIAL", 1, 2},
    {M::kOpenCV, "OPENCV", 2, 4},
    {M::kOpenCVFisheye, "OPENCV_FISHEYE", 2, 4},
    {M::kFullOpenCV, "FULL_OPENCV", 2, 8},
    {M::kFov, "FOV", 2, 1},
    {M::kSimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 1, 1},
    {M::kRadialFisheye, "RADIAL_FISHEYE", 1, 2},
    {M::kThinPrismFisheye, "THIN_PRISM_FISHEYE", 2, 8},
    {M::kRadTanThinPrismFisheye, "RAD_TAN_THIN_PRISM_FISHEYE", 2, 12},
    {M::kSimpleDivision, "SIMPLE_DIVISION", 1, 1},
    {M::kDivision, "DIVISION", 2, 1},
    {M::kSimpleFisheye, "SIMPLE_FISHEYE", 1, 0},
    {M::kFisheye, "FISHEYE", 2, 0},
    {M::kEucm, "EUCM", 2, 2},
    {M::kEquirectangular, "EQUIRECTANGULAR", 0, 0},
};

bool is_fisheye(CameraModel model) {
    switch (model) {
        case M::kOpenCVFisheye:
        case M::kSimpleRadialFisheye:
        case M::kRadialFisheye:
        case M::kThinPrismFisheye:
        case M::kRadTanThinPrismFisheye:
        case M::kSimpleFisheye:
        case M::kFisheye:
            return true;
        default:
            return false;
    }
}

/// Returns true for models whose distortion is a polynomial map of the (possibly equidistant) image plane. Newton's
/// method inverts it.
bool is_polynomial(CameraModel model) {
    switch (model) {
        case M::kSimpleRadial:
        case M::kRadial:
        case M::kOpenCV:
        case M::kFullOpenCV:
            return true;
        default:
            return is_fisheye(model);
    }
}

/// Returns the sum of k[i] s^(i+1).
template <class T> T power_series(const double* k, int count, const T& s) {
    T sum(0.0);
    for (int i = count; i-- > 0;) sum = (sum + k[i]) * s;
    return sum;
}

/// Distorts a point of the image plane by COLMAP's polynomial models. T is double or a type for automatic
/// differentiation.
template <class T> Eigen::Matrix<T, 2, 1> distort_plane(const LensCamera& lens, const T& x, const T& y) {
    const std::array<double, 12>& d = lens.distortion;
    const T s = x * x + y * y;
    T radial(1.0), dx(0.0), dy(0.0);
    const auto add_tangential = [&](const T& u, const T& v, const T& rho2, double p1, double p2) {
        dx += 2 * p1 * u * v + p2 * (rho2 + 2 * u * u);
        dy += 2 * p2 * u * v + p1 * (rho2 + 2 * v * v);
    };
    switch (lens.model) {
        case M::kSimpleRadial:
        case M::kSimpleRadialFisheye:
            radial += power_series(&d[0], 1, s);
            break;
        case M::kRadial:
        case M::kRadialFisheye:
            radial += power_series(&d[0], 2, s);
            break;
        case M::kOpenCVFisheye:
            radial += power_series(&d[0], 4, s);
            break;
        case M::kOpenCV:
            radial += power_series(&d[0], 2, s);
            add_tangential(x, y, s, d[2], d[3]);
            break;
        case M::kFullOpenCV: {
            const double numerator[3] = {d[0], d[1], d[4]};
            radial = (radial + power_series(numerator, 3, s)) / (1 + power_series(&d[5], 3, s));
            add_tangential(x, y, s, d[2], d[3]);
            break;
        }
        case M::kThinPrismFisheye: {
            const double k[4] = {d[0], d[1], d[4], d[5]};
            radial += power_series(k, 4, s);
            add_tangential(x, y, s, d[2], d[3]);
            dx += d[6] * s;
            dy += d[7] * s;
            break;
        }
        case M::kRadTanThinPrismFisheye: {
            radial += power_series(&d[0], 6, s);
            const T u = x * radial, v = y * radial, rho2 = u * u + v * v;
            add_tangential(u, v, rho2, d[7], d[6]);
            dx += d[8] * rho2 + d[9] * rho2 * rho2;
            dy += d[10] * rho2 + d[11] * rho2 * rho2;
            break;
        }
        default:
            break;
    }
    return {T(x * radial + dx), T(y * radial + dy)};
}

struct PlaneMap {
    Vector2d value;
    Eigen::Matrix2d jacobian;
};

PlaneMap distort_with_jacobian(const LensCamera& lens, const Vector2d& x) {
    using Dual = Eigen::AutoDiffScalar<Vector2d>;
    const auto result = distort_plane<Dual>(lens, Dual(x.x(), 2, 0), Dual(x.y(), 2, 1));
    PlaneMap map;
    for (int i = 0; i < 2; ++i) {
        map.value[i] = result[i].value();
        map.jacobian.row(i) = result[i].derivatives().transpose();
    }
    return map;
}

/// Solves distort_plane(x) = target. The step length is limited, so that strong distortion cannot move the iterate past
/// the fold.
std::optional<Vector2d> invert_plane(const LensCamera& lens, const Vector2d& target) {
    // COLMAP stops at a squared step of 1e-10. Convergence is quadratic, so a few more digits cost one step and make
    // the round trip exact to 1e-9 px.
    constexpr int kMaxIterations = 100;
    constexpr double kSquaredStep = 1e-24;
    Vector2d x = target;
    for (int i = 0; i < kMaxIterations; ++i) {
        const PlaneMap map = distort_with_jacobian(lens, x);
        const double determinant = map.jacobian.determinant();
        if (!std::isfinite(determinant) || determinant == 0) return {};
        Vector2d step = map.jacobian.inverse() * (map.value - target);
        const double length = step.norm(), limit = std::max(0.1 * x.norm(), 0.1);
        if (!std::isfinite(length)) return {};
        if (length > limit) step *= limit / length;
        x -= step;
        if (step.squaredNorm() < kSquaredStep * std::max(1.0, x.squaredNorm())) {
            if (distort_with_jacobian(lens, x).jacobian.determinant() <= 0) return {};
            return x;
        }
    }
    return {};
}

double fov_factor(double r, double omega) {
    const double t = std::tan(omega / 2);
    if (std::abs(omega) < 1e-9) return 1;
    return r < 1e-9 ? 2 * t / omega : std::atan(2 * r * t) / (r * omega);
}

/// Returns the normalised image coordinates of the ray (u,v,1).
std::optional<Vector2d> distort(const LensCamera& lens, const Vector2d& uv) {
    const double r2 = uv.squaredNorm();
    if (is_polynomial(lens.model)) {
        Vector2d plane = uv;
        const double r = std::sqrt(r2);
        if (is_fisheye(lens.model) && r > 0) plane *= std::atan(r) / r;
        const PlaneMap map = distort_with_jacobian(lens, plane);
        if (!(map.jacobian.determinant() > 0)) return {};
        return map.value;
    }
    const std::array<double, 12>& d = lens.distortion;
    switch (lens.model) {
        case M::kFov:
            return Vector2d(uv * fov_factor(std::sqrt(r2), d[0]));
        case M::kSimpleDivision:
        case M::kDivision: {
            const double root = 1 - 4 * d[0] * r2;
            if (root < 0) return {};
            return Vector2d(uv * (2 / (1 + std::sqrt(root))));
        }
        case M::kEucm: {
            const double root = d[1] * r2 + 1;
            if (root < 0) return {};
            const double depth = d[0] * std::sqrt(root) + 1 - d[0];
            if (!(depth > 0)) return {};
            return Vector2d(uv / depth);
        }
        default:
            return uv;
    }
}

/// Inverts `distort`.
std::optional<Vector2d> undistort(const LensCamera& lens, const Vector2d& xy) {
    const double r2 = xy.squaredNorm();
    if (is_polynomial(lens.model)) {
        std::optional<Vector2d> plane = invert_plane(lens, xy);
        if (!plane || !is_fisheye(lens.model)) return plane;
        const double theta = plane->norm();
        if (theta >= std::numbers::pi / 2) return {};
        if (theta > 0) *plane *= std::tan(theta) / theta;
        return plane;
    }
    const std::array<double, 12>& d = lens.distortion;
    switch (lens.model) {
        case M::kFov: {
            const double r = std::sqrt(r2), omega = d[0], t = std::tan(omega / 2);
            if (std::abs(omega) < 1e-9) return xy;
            if (std::abs(r * omega) >= std::numbers::pi / 2) return {};
            return Vector2d(xy * (r < 1e-9 ? omega / (2 * t) : std::tan(r * omega) / (2 * r * t)));
        }
        case M::kSimpleDivision:
        case M::kDivision: {
            const double scale = 1 + d[0] * r2;
            // Beyond |k| r^2 = 1 the square root of the projection is on another branch than at the centre.
            if (!(scale > 0) || d[0] * r2 > 1) return {};
            return Vector2d(xy / scale);
        }
        case M::kEucm: {
            const double alpha = d[0], beta = d[1];
            const double root = 1 - (2 * alpha - 1) * beta * r2;
            if (root < 0) return {};
            const double h = (1 - alpha * alpha * beta * r2) / (alpha * std::sqrt(root) + 1 - alpha);
            if (!(h > 0)) return {};
            return Vector2d(xy / h);
        }
        default:
            return xy;
    }
}

}  // namespace

std::span<const CameraModelInfo> camera_models() { return kModels; }

const CameraModelInfo& camera_model_info(CameraModel model) { return kModels[static_cast<int>(model)]; }

LensCamera make_lens_camera(CameraModel model, int width, int height, std::span<const double> params) {
    const CameraModelInfo& info = camera_model_info(model);
    LensCamera lens{.model = model, .width = width, .height = height};
    if (info.num_focal == 0) {
        lens.fx = params[0];
        lens.fy = params[1];
        return lens;
    }
    std::size_t next = 0;
    lens.fx = params[next++];
    lens.fy = info.num_focal == 2 ? params[next++] : lens.fx;
    lens.cx = params[next++];
    lens.cy = params[next++];
    std::copy(params.begin() + next, params.end(), lens.distortion.begin());
    return lens;
}

LensCamera scaled_to(const LensCamera& lens, int width, int height) {
    const double sx = double(width) / lens.width, sy = double(height) / lens.height;
    LensCamera out = lens;
    out.width = width;
    out.height = height;
    out.fx *= sx;
    out.cx *= sx;
    out.fy *= sy;
    out.cy *= sy;
    return out;
}

bool is_pinhole(const LensCamera& lens) {
    switch (lens.model) {
        case M::kSimplePinhole:
        case M::kPinhole:
            return true;
        case M::kSimpleRadial:
        case M::kRadial:
        case M::kOpenCV:
        case M::kFullOpenCV:
            return std::all_of(lens.distortion.begin(), lens.distortion.end(), [](double d) { return d == 0; });
        default:
            return false;
    }
}

std::optional<Vector2d> project(const LensCamera& lens, const Vector3d& point) {
    if (lens.model == M::kEquirectangular) {
        const double theta = std::atan2(point.x(), point.z());
        const double phi = std::atan2(-point.y(), std::hypot(point.x(), point.z()));
        return Vector2d((theta / (2 * std::numbers::pi) + 0.5) * lens.fx, (0.5 - phi / std::numbers::pi) * lens.fy);
    }
    if (!(point.z() > 0)) return {};
    const std::optional<Vector2d> xy = distort(lens, Vector2d(point.x() / point.z(), point.y() / point.z()));
    if (!xy) return {};
    return Vector2d(lens.fx * xy->x() + lens.cx, lens.fy * xy->y() + lens.cy);
}

std::optional<Vector3d> unproject(const LensCamera& lens, const Vector2d& pixel) {
    if (lens.model == M::kEquirectangular) {
        const double theta = (pixel.x() / lens.fx - 0.5) * 2 * std::numbers::pi;
        const double phi = (0.5 - pixel.y() / lens.fy) * std::numbers::pi;
        return Vector3d(std::cos(phi) * std::sin(theta), -std::sin(phi), std::cos(phi) * std::cos(theta));
    }
    const std::optional<Vector2d> uv =
        undistort(lens, Vector2d((pixel.x() - lens.cx) / lens.fx, (pixel.y() - lens.cy) / lens.fy));
    if (!uv || !uv->allFinite()) return {};
    return Vector3d(uv->x(), uv->y(), 1);
}

}  // namespace gs
