// SPDX-License-Identifier: Apache-2.0
// The lens models of COLMAP: their names, their parameters and their projection in both directions, in double.
#include "lib/scene/camera_models.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

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

struct PlaneMap {
    Vector2d value;
    Eigen::Matrix2d jacobian;
};

PlaneMap distort_with_jacobian(const Lens<double>& lens, const Vector2d& p) {
    using J = Jet<double>;
    const Vec2<J> at = distort_plane(lens, J::linear(p.x(), 1, 0), J::linear(p.y(), 0, 1));
    PlaneMap map{{at.x.value, at.y.value}, {}};
    map.jacobian << at.x.x, at.x.y, at.y.x, at.y.y;
    return map;
}

/// Solves distort_plane(x) = target. The step length is limited, so that strong distortion cannot move the iterate past
/// the fold.
std::optional<Vector2d> invert_plane(const Lens<double>& lens, const Vector2d& target) {
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

/// Returns the direction of a point of the plane of a pinhole image.
Vector3d ray_of(const Vector2d& uv) { return Vector3d(uv.x(), uv.y(), 1).normalized(); }

/// Inverts distort_direction. `xy` are normalised image coordinates.
std::optional<Vector3d> undistort(const LensCamera& camera, const Vector2d& xy) {
    const double r2 = xy.squaredNorm(), r = std::sqrt(r2);
    const auto at_angle = [](const Vector2d& toward, double angle) {
        const double length = toward.norm();
        const Vector2d side = length > 0 ? Vector2d(toward * (std::sin(angle) / length)) : Vector2d::Zero();
        return Vector3d(side.x(), side.y(), std::cos(angle));
    };
    const Lens<double> lens = kernel_lens<double>(camera, {});
    if (is_fisheye(camera.model)) {
        const std::optional<Vector2d> plane = invert_plane(lens, xy);
        if (!plane || plane->norm() >= std::numbers::pi) return {};
        return at_angle(*plane, plane->norm());
    }
    if (is_plane_polynomial(camera.model)) {
        const std::optional<Vector2d> plane = is_pinhole(camera) ? xy : invert_plane(lens, xy);
        if (!plane) return {};
        return ray_of(*plane);
    }
    const std::array<double, 12>& d = camera.distortion;
    switch (camera.model) {
        case M::kFov: {
            const double omega = std::abs(d[0]), scaled = r * omega;
            if (!(omega > 0)) return ray_of(xy);
            if (scaled >= std::numbers::pi) return {};
            // tan(r omega) = 2 tan(omega / 2) tan(angle), in the same quadrant
            return at_angle(xy, std::atan2(std::sin(scaled), 2 * std::tan(omega / 2) * std::cos(scaled)));
        }
        case M::kSimpleDivision:
        case M::kDivision: {
            // Beyond |k| r^2 = 1 the square root of the projection is on another branch than at the centre.
            if (d[0] * r2 > 1) return {};
            return Vector3d(xy.x(), xy.y(), 1 + d[0] * r2).normalized();
        }
        case M::kEucm: {
            const double alpha = d[0], beta = d[1];
            const double root = 1 - (2 * alpha - 1) * beta * r2;
            if (root < 0) return {};
            const double depth = (1 - alpha * alpha * beta * r2) / (alpha * std::sqrt(root) + 1 - alpha);
            return Vector3d(xy.x(), xy.y(), depth).normalized();
        }
        default:
            return ray_of(xy);
    }
}

/// The image point of a direction and how it changes with it.
struct DirectionMap {
    Vector2d value;      ///< normalised image coordinates
    double determinant;  ///< of the Jacobian by the direction; positive where the lens is one to one
    double radial;       ///< growth of the distance from the image point of the axis, per radian
};

/// Returns nothing outside the model's domain.
std::optional<DirectionMap> map_direction(const LensCamera& camera, const Lens<double>& lens,
                                          const Vector3d& direction) {
    if ((is_plane_polynomial(camera.model) || is_pinhole(camera)) && !(direction.z() > 0)) return {};
    const Vector3d n = direction.normalized();
    // Where the model has no root, the values below are NaN.
    if (camera.model == M::kEucm) {
        const double root = camera.distortion[1] * (1 - n.z() * n.z()) + n.z() * n.z();
        if (!(camera.distortion[0] * std::sqrt(root) + (1 - camera.distortion[0]) * n.z() > 0)) return {};
    }
    using J = Jet<double>;
    Vec3<double> e1, e2;
    tangent_basis(Vec3<double>{n.x(), n.y(), n.z()}, e1, e2);
    const Vec2<J> at = distort_direction(
        lens, Vec3<J>{J::linear(n.x(), e1.x, e2.x), J::linear(n.y(), e1.y, e2.y), J::linear(n.z(), e1.z, e2.z)});
    const Vector2d value(at.x.value, at.y.value);
    // The derivative along the great circle through the axis, and its part away from the axis's image point.
    const double rho = std::hypot(n.x(), n.y());
    const Vector3d outward = rho > 0 ? Vector3d(n.x() * n.z() / rho, n.y() * n.z() / rho, -rho) : Vector3d(1, 0, 0);
    const double a = outward.dot(Vector3d(e1.x, e1.y, e1.z)), b = outward.dot(Vector3d(e2.x, e2.y, e2.z));
    const Vector2d slope(at.x.x * a + at.x.y * b, at.y.x * a + at.y.y * b);
    const double length = value.norm();
    DirectionMap map{value, at.x.x * at.y.y - at.x.y * at.y.x, length > 0 ? slope.dot(value) / length : slope.norm()};
    if (!map.value.allFinite() || !std::isfinite(map.determinant) || !std::isfinite(map.radial)) return {};
    return map;
}

}  // namespace

std::span<const CameraModelInfo> camera_models() { return kModels; }

bool is_plane_polynomial(CameraModel model) {
    return model == M::kSimpleRadial || model == M::kRadial || model == M::kOpenCV || model == M::kFullOpenCV;
}

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

LensRange lens_range(const LensCamera& camera) {
    if (camera.model == M::kEquirectangular) return {std::numbers::pi, 0, false};
    const Lens<double> lens = kernel_lens<double>(camera, {});
    constexpr int kPlanes = 32, kSteps = 180;
    constexpr double kStep = std::numbers::pi / kSteps, kMargin = 0.15;
    // Near its fold a lens squeezes ever larger angles into a pixel, which no splat is made for.
    constexpr double kLeastSlope = 0.4;
    const auto at = [&](int plane, double angle) {
        const double azimuth = 2 * std::numbers::pi * (plane + 0.5) / kPlanes;
        const auto map = map_direction(
            camera, lens, {std::sin(angle) * std::cos(azimuth), std::sin(angle) * std::sin(azimuth), std::cos(angle)});
        return map && map->determinant > 0 && map->radial >= kLeastSlope ? map : std::nullopt;
    };
    const auto in_image = [&](const DirectionMap& map) {
        const double x = camera.fx * map.value.x() + camera.cx, y = camera.fy * map.value.y() + camera.cy;
        return x >= -kMargin * camera.width && x <= (1 + kMargin) * camera.width && y >= -kMargin * camera.height &&
               y <= (1 + kMargin) * camera.height;
    };
    double fold = std::numbers::pi, reach = 0;
    for (int plane = 0; plane < kPlanes; ++plane) {
        for (int step = 1; step <= kSteps && step * kStep < fold + kStep; ++step) {
            const auto map = at(plane, step * kStep - 0.5 * kStep);
            if (map) {
                if (in_image(*map)) reach = std::max(reach, step * kStep);
                continue;
            }
            double low = (step - 1.5) * kStep, high = (step - 0.5) * kStep;
            while (high - low > 1e-6) (at(plane, std::max(0.5 * (low + high), 1e-9)) ? low : high) = 0.5 * (low + high);
            fold = std::min(fold, std::max(low, 0.0));
            break;
        }
    }
    const bool folds = fold < reach + kStep;  // the last step that is seen may end before the fold
    LensRange range{folds ? fold : reach, 0, folds};
    for (int plane = 0; plane < kPlanes; ++plane)
        if (const auto map = at(plane, range.max_angle)) range.slope += map->radial / kPlanes;
    range.slope = std::max(range.slope, kLeastSlope);
    return range;
}

std::optional<Vector2d> project(const LensCamera& lens, const Vector3d& point) {
    const Lens<double> kernel = kernel_lens<double>(lens, {});
    if (lens.model == M::kEquirectangular) {
        const Vec2<double> p = distort_direction(kernel, Vec3<double>{point.x(), point.y(), point.z()});
        return Vector2d(p.x * lens.fx, p.y * lens.fy);
    }
    const std::optional<DirectionMap> map = map_direction(lens, kernel, point);
    if (!map || !(map->determinant > 0)) return {};
    // A lens that turned back at its fold and has passed its centre since is one to one again, on the other side.
    if (map->value.dot(point.head<2>()) < 0 && point.head<2>().norm() > 0.1 * point.norm()) return {};
    return Vector2d(lens.fx * map->value.x() + lens.cx, lens.fy * map->value.y() + lens.cy);
}

std::optional<Vector3d> unproject(const LensCamera& lens, const Vector2d& pixel) {
    if (lens.model == M::kEquirectangular) {
        const Vec3<double> ray = lens_ray(kernel_lens<double>(lens, {}), pixel.x() / lens.fx, pixel.y() / lens.fy);
        return Vector3d(ray.x, ray.y, ray.z);
    }
    const std::optional<Vector3d> ray =
        undistort(lens, Vector2d((pixel.x() - lens.cx) / lens.fx, (pixel.y() - lens.cy) / lens.fy));
    if (!ray || !ray->allFinite()) return {};
    return ray;
}

}  // namespace gs
