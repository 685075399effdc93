// SPDX-License-Identifier: Apache-2.0
// Moves one camera along the gradient of a loss by its pose (docs/math/cameras.md).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kernels/splat/camera_gradient.h"
#include "lib/scene/scene.h"

namespace gs {

using Vector6d = Eigen::Matrix<double, 6, 1>;

/// The pixel of a point, and its derivative by the point in camera space.
struct PixelOfPoint {
    Eigen::Vector2d at;
    Eigen::Matrix<double, 2, 3> by_point;

    /// Returns the derivative by a turn w of the camera about its centre, radians, and a shift of its centre, both in
    /// its axes. `point` is in camera space.
    Eigen::Matrix<double, 2, 6> by_pose(const Eigen::Vector3d& point) const;
};

/// Projects a point in camera space; nothing if the camera does not see that direction.
std::optional<PixelOfPoint> pixel_of(const Camera& camera, const Eigen::Vector3d& point);

/// Returns the derivative of the pixel of a point in camera space by the first coefficient of distortion; 0 for a
/// pinhole.
Eigen::Vector2d pixel_by_coefficient(const Camera& camera, const Eigen::Vector3d& point);

/// Returns the camera turned about its centre and then shifted, both in the axes that it had before.
Camera moved_by(Camera camera, const Vector6d& by);

/// Returns the turn and shift, in the axes of `given`, by which moved_by() makes it `now`.
Vector6d correction_of(const Camera& given, const Camera& now);

/// The mean Huber distance, in pixels, between where an image shows its points and where its camera does: half the
/// square up to 1 pixel, linear beyond. With its gradient and its Hessian (Gauss-Newton) by turn and shift, then by the
/// common logarithm of the focal lengths, the principal point and the first coefficient of distortion. All 0 without
/// observations.
struct TrackError {
    double mean = 0;
    Eigen::Matrix<double, 10, 1> gradient = Eigen::Matrix<double, 10, 1>::Zero();
    Eigen::Matrix<double, 10, 10> hessian = Eigen::Matrix<double, 10, 10>::Zero();
};
TrackError track_error(const Camera& camera, const std::vector<PointObservation>& observations);

/// Returns a kernel's gradient by turn and shift in the axes of the camera.
Vector6d pose_gradient(const Camera& camera, const CameraGradient<double>& gradient);

/// Learns a pose in coordinates in which every direction moves the points that the camera sees by as much: one unit is
/// a root mean square of one pixel (Park et al. 2023, CamP).
class PoseLearner {
  public:
    PoseLearner() = default;
    /// `points` are points of the scene, of which the camera sees some.
    PoseLearner(const Camera& start, const std::vector<Eigen::Vector3d>& points);

    /// Moves the camera against the gradient by turn and shift: by about `rate` pixels along each direction, and not
    /// farther than `bound` pixels from where it began. `pull` is the weight in the loss of half the square of the way
    /// from there, linear beyond a pixel. A gradient that is not finite moves nothing.
    void step(Camera& camera, const Vector6d& gradient, double rate, double pull, double bound);
    /// Returns the way from where it began to a camera, pixels along each direction.
    Vector6d way_to(const Camera& camera) const;
    /// Returns the root mean square way of points from one camera to another, pixels, to first order.
    double pixels(const Camera& from, const Camera& to) const { return (to_pixels_ * correction_of(from, to)).norm(); }
    /// Returns the camera with the pose where it began and the lens of `camera`, moved by such a way.
    Camera moved(Camera camera, const Vector6d& way) const;
    const Camera& start() const { return start_; }

    /// First moments of the gradient by coordinate, its second moment, and the number of steps.
    static constexpr int kMoments = 8;
    double* moments() { return moments_; }
    const double* moments() const { return moments_; }

  private:
    Camera start_;
    Eigen::Matrix<double, 6, 6> from_pixels_ = Eigen::Matrix<double, 6, 6>::Identity(),
                                to_pixels_ = Eigen::Matrix<double, 6, 6>::Identity();
    double moments_[kMoments] = {};
};

/// Returns the largest correction of a camera, pixels.
double largest_correction(const LensCamera& camera);

/// Returns a rate that falls from `first` to 0 with half a wave of a cosine, after a share 0..1 of its steps.
double falling_rate(double first, double share);

/// A step of Adam whose second moment is common to all coordinates, so that it does not depend on the choice of the
/// axes. moments: `size` first moments, the second moment, the number of steps. Sets the direction, whose
/// coordinates are about 1 long, and returns the root of the second moment, which is 0 while all gradients are 0.
double adam_direction(double* moments, int size, const double* gradient, double* direction);

/// Returns the share of a way from its start that is left when a pull towards the start, with this weight in the loss,
/// has acted beside a step of Adam of such a rate and such a root of the second moment. The pull is followed
/// implicitly, so that a strong one does not overshoot. Half the square of the way, linear beyond 1, is what it weighs.
double share_after_pull(double way, double weight, double rate, double root);

}  // namespace gs
