// SPDX-License-Identifier: Apache-2.0
// Coordinates of a pose in pixels, and steps in them.
#include "lib/train/pose_learner.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "lib/scene/camera_params.h"

namespace gs {
namespace {

using Eigen::Matrix3d, Eigen::Vector2d, Eigen::Vector3d;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

Matrix3d cross_matrix(const Vector3d& v) {
    return (Matrix3d() << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0).finished();
}

Matrix3d turn_by(const Vector3d& w) {
    const double angle = w.norm();
    return angle > 0 ? Eigen::AngleAxisd(angle, w / angle).toRotationMatrix() : Matrix3d::Identity();
}

Vector3d turn_of(const Matrix3d& rotation) {
    const Eigen::AngleAxisd turn(rotation);
    return turn.angle() * turn.axis();
}

bool is_in_image(const Camera& camera, const Vector2d& at) {
    return at.x() >= 0 && at.y() >= 0 && at.x() < camera.width && at.y() < camera.height;
}

}  // namespace

Camera moved_by(Camera camera, const Vector6d& by) {
    const Vector3d center = camera.center() + camera.rotation.transpose() * by.tail<3>();
    camera.rotation = turn_by(by.head<3>()) * camera.rotation;
    camera.translation = -(camera.rotation * center);
    return camera;
}

Vector6d correction_of(const Camera& given, const Camera& now) {
    Vector6d by;
    by << turn_of(now.rotation * given.rotation.transpose()), given.rotation * (now.center() - given.center());
    return by;
}

Eigen::Matrix<double, 2, 6> PixelOfPoint::by_pose(const Vector3d& point) const {
    Eigen::Matrix<double, 2, 6> out;
    out << by_point * -cross_matrix(point), -by_point;
    return out;
}

std::optional<PixelOfPoint> pixel_of(const Camera& camera, const Vector3d& point) {
    if (!camera.is_used_at(point)) return {};
    const auto at = project(camera, point);
    if (!at) return {};
    PixelOfPoint out{*at, Eigen::Matrix<double, 2, 3>::Zero()};
    if (is_pinhole(camera)) {
        const double inverse = 1 / point.z();
        out.by_point << camera.fx * inverse, 0, -camera.fx * point.x() * inverse * inverse,  //
            0, camera.fy * inverse, -camera.fy * point.y() * inverse * inverse;
        return out;
    }
    const double distance = point.norm();
    const Vec3<double> d{point.x() / distance, point.y() / distance, point.z() / distance};
    Vec3<double> e1, e2;
    tangent_basis(d, e1, e2);
    const LensPoint<double> p = lens_point_at(kernel_lens<double>(camera, camera.range), d, e1, e2);
    const Eigen::RowVector3d a(e1.x, e1.y, e1.z), b(e2.x, e2.y, e2.z);
    out.by_point.row(0) = camera.fx / distance * (p.x.x * a + p.x.y * b);
    out.by_point.row(1) = camera.fy / distance * (p.y.x * a + p.y.y * b);
    return out;
}

Vector2d pixel_by_coefficient(const Camera& camera, const Vector3d& point) {
    if (is_pinhole(camera)) return Vector2d::Zero();
    const Vec3<double> direction{point.x(), point.y(), point.z()}, no_change{0, 0, 0};
    const LensPoint<double> by =
        lens_point_by_coefficient(kernel_lens<double>(camera, camera.range), direction, no_change, no_change);
    return {camera.fx * by.x.value, camera.fy * by.y.value};
}

TrackError track_error(const Camera& camera, const std::vector<PointObservation>& observations) {
    TrackError out;
    const Vector2d size(camera.width, camera.height), middle(camera.cx, camera.cy);
    const double share = 1 / double(observations.size());
    for (const PointObservation& seen : observations) {
        const Vector3d point = camera.rotation * seen.point + camera.translation;
        const auto pixel = pixel_of(camera, point);
        if (!pixel) continue;
        const Vector2d off = pixel->at - seen.at.cwiseProduct(size);
        const double distance = off.norm(), weight = share / std::max(1.0, distance);
        Eigen::Matrix<double, 2, 10> by;
        by << pixel->by_pose(point), pixel->at - middle, Eigen::Matrix2d::Identity(),
            pixel_by_coefficient(camera, point);
        out.mean += share * (distance > 1 ? distance - 0.5 : 0.5 * distance * distance);
        out.gradient += by.transpose() * off * weight;
        out.hessian += by.transpose() * by * weight;
    }
    return out;
}

Vector6d pose_gradient(const Camera& camera, const CameraGradient<double>& gradient) {
    Vector6d out;
    out << camera.rotation * Vector3d(gradient.rotation.x, gradient.rotation.y, gradient.rotation.z),
        camera.rotation * Vector3d(gradient.position.x, gradient.position.y, gradient.position.z);
    return out;
}

PoseLearner::PoseLearner(const Camera& start, const std::vector<Vector3d>& points) : start_(start) {
    // Coordinates along which the points hardly move are not to take long ways.
    constexpr double kLeast = 0.01;
    Matrix6d sum = Matrix6d::Zero();
    double count = 0;
    const auto add = [&](const Vector3d& point) {
        const auto pixel = pixel_of(start, point);
        if (!pixel || !is_in_image(start, pixel->at)) return;
        const auto by_pose = pixel->by_pose(point);
        sum += by_pose.transpose() * by_pose;
        ++count;
    };
    for (const Vector3d& point : points) {
        const Vector3d in_camera = start.rotation * point + start.translation;
        if (in_camera.norm() >= CameraParams<double>{}.near_plane) add(in_camera);
    }
    if (count < 6) {  // a wall of the scene's usual size before the camera
        for (const double x : {-0.3, 0.0, 0.3})
            for (const double y : {-0.3, 0.0, 0.3}) add(Vector3d(x, y, 1) * (5 + x + y));
    }
    if (count == 0) return;
    sum /= count;
    const Vector6d scale = sum.diagonal().cwiseMax(1e-12).cwiseSqrt();
    const Matrix6d scaled = scale.cwiseInverse().asDiagonal() * sum * scale.cwiseInverse().asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scaled);
    const Vector6d roots = solver.eigenvalues().cwiseMax(kLeast).cwiseSqrt();
    const Matrix6d& axes = solver.eigenvectors();
    from_pixels_ = scale.cwiseInverse().asDiagonal() * axes * roots.cwiseInverse().asDiagonal() * axes.transpose();
    to_pixels_ = axes * roots.asDiagonal() * axes.transpose() * scale.asDiagonal();
}

Vector6d PoseLearner::way_to(const Camera& camera) const { return to_pixels_ * correction_of(start_, camera); }

Camera PoseLearner::moved(Camera camera, const Vector6d& way) const {
    camera.rotation = start_.rotation, camera.translation = start_.translation;
    return moved_by(camera, from_pixels_ * way);
}

void PoseLearner::step(Camera& camera, const Vector6d& gradient, double rate, double pull, double bound) {
    const Vector6d by_pixels = from_pixels_.transpose() * gradient;
    if (!by_pixels.allFinite()) return;
    Vector6d direction;
    const double root = adam_direction(moments_, 6, by_pixels.data(), direction.data());
    if (root == 0) return;
    const Vector6d way = way_to(moved_by(camera, from_pixels_ * (-rate * direction)));
    const double length = way.norm(), left = share_after_pull(length, pull, rate, root);
    camera = moved(camera, way * (length * left > bound ? bound / length : left));
}

double largest_correction(const LensCamera& camera) { return 0.03 * std::max(camera.width, camera.height); }

double falling_rate(double first, double share) {
    return first * 0.5 * (1 + std::cos(std::numbers::pi * std::clamp(share, 0.0, 1.0)));
}

double adam_direction(double* moments, int size, const double* gradient, double* direction) {
    constexpr double kFirst = 0.9, kSecond = 0.98;
    double &second = moments[size], &steps = moments[size + 1], square = 0;
    for (int k = 0; k < size; ++k) {
        moments[k] = kFirst * moments[k] + (1 - kFirst) * gradient[k];
        square += gradient[k] * gradient[k] / size;
    }
    second = kSecond * second + (1 - kSecond) * square;
    ++steps;
    const double root = std::sqrt(second / (1 - std::pow(kSecond, steps)));
    for (int k = 0; k < size; ++k) direction[k] = root > 0 ? moments[k] / (1 - std::pow(kFirst, steps)) / root : 0;
    return root;
}

double share_after_pull(double way, double weight, double rate, double root) {
    return 1 / (1 + rate / root * weight / std::max(1.0, std::abs(way)));
}

}  // namespace gs
