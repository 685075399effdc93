// SPDX-License-Identifier: Apache-2.0
// Finds the up direction, and rotates Gaussians and cameras.
#include "lib/export/turn.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/export/sh_projection.h"

namespace gs {
namespace {

/// The least mean square spread of horizontal axes in a plane that determines the plane's normal: the spread of cameras
/// that look 13 degrees to both sides.
constexpr double kLeastSpread = 0.05;
/// Number of directions sampled for the fit of a rotation. The 15 coefficients need somewhat more than 16.
constexpr int kTurnDirections = 64;

/// Photographs are assumed to lie on their side if the vertical axes' plane has less than this fraction of the
/// thickness of the horizontal axes' plane.
constexpr double kClearly = 0.25;

/// The plane that fits a set of directions.
struct Plane {
    Eigen::Vector3d normal;
    double thickness = 0;  ///< mean square distance of the directions from the plane
    bool known = false;    ///< whether the directions determine the plane
};

/// Returns the plane of one row of the cameras' rotations: row 0 has the horizontal axes, row 1 the vertical axes.
Plane plane_of(const std::vector<Camera>& cameras, Eigen::Index row) {
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Camera& camera : cameras) {
        const Eigen::Vector3d axis = camera.rotation.row(row).transpose();
        spread += axis * axis.transpose() / double(cameras.size());
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);  // eigenvalues rise
    return {axes.eigenvectors().col(0), axes.eigenvalues()[0], axes.eigenvalues()[1] >= kLeastSpread};
}

/// Returns the mean of a row of the cameras' rotations.
Eigen::Vector3d mean_row(const std::vector<Camera>& cameras, Eigen::Index row) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Camera& camera : cameras) mean += camera.rotation.row(row).transpose() / double(cameras.size());
    return mean;
}

}  // namespace

std::optional<Eigen::Vector3d> find_up(const std::vector<Camera>& cameras) {
    if (cameras.empty()) return std::nullopt;
    const Plane level = plane_of(cameras, 0), lying = plane_of(cameras, 1);
    const auto towards = [](const Eigen::Vector3d& normal, const Eigen::Vector3d& side) {
        return normal.dot(side) < 0 ? Eigen::Vector3d(-normal) : normal;
    };
    if (lying.known && (!level.known || lying.thickness < kClearly * level.thickness)) {
        const Eigen::Vector3d right = mean_row(cameras, 0);
        // On a ring of cameras, vertical axes are horizontal only if the photographs lie on their side.
        if (std::abs(lying.normal.dot(right)) >= 0.5) return towards(lying.normal, -mean_row(cameras, 2));
    }
    const Eigen::Vector3d mean = -mean_row(cameras, 1);  // the camera's y axis points down
    if (!(mean.norm() > 1e-6)) return std::nullopt;
    if (!level.known || std::abs(level.normal.dot(mean)) < 0.5 * mean.norm()) return mean.normalized();
    return towards(level.normal, mean);
}

Eigen::Vector3d up_direction(const std::vector<Camera>& cameras) {
    const auto up = find_up(cameras);
    if (!up) throw UsageError("the cameras do not say which way is up");
    return *up;
}

Eigen::Matrix3d turn_to(const Eigen::Vector3d& up, const Eigen::Vector3d& axis) {
    Eigen::Index main = 0;
    up.cwiseAbs().maxCoeff(&main);
    const Eigen::Vector3d nearest = Eigen::Vector3d::Unit(main) * (up[main] < 0 ? -1 : 1);
    const Eigen::Matrix3d coarse =
        nearest.dot(axis) < -0.5
            ? Eigen::Vector3d(1, -1, -1).asDiagonal().toDenseMatrix()  // half a turn about x
            : Eigen::Quaterniond::FromTwoVectors(nearest, axis).toRotationMatrix().array().round().matrix();
    return Eigen::Quaterniond::FromTwoVectors(coarse * up, axis).toRotationMatrix() * coarse;
}

Eigen::MatrixXd sh_turn(const Eigen::Matrix3d& rotation, int degree) {
    const std::vector<Vec3<double>> at = sphere_directions(kTurnDirections);
    std::vector<Vec3<double>> turned_at;
    for (const Vec3<double>& d : at) {
        const Eigen::Vector3d t = rotation * Eigen::Vector3d(d.x, d.y, d.z);
        turned_at.push_back({t.x(), t.y(), t.z()});
    }
    const Eigen::MatrixXd before = sh_basis_matrix(at, degree), after = sh_basis_matrix(turned_at, degree);
    const Eigen::MatrixXd whole = after.completeOrthogonalDecomposition().solve(before);
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(whole.rows() - 1, whole.cols() - 1);
    // Bands do not mix: any coupling in the fit is rounding error.
    for (int band = 1; band <= degree; ++band) {
        const int first = band * band, size = 2 * band + 1;
        out.block(first - 1, first - 1, size, size) = whole.block(first, first, size, size);
    }
    return out;
}

void turn(Gaussians& g, const Eigen::Matrix3d& rotation) {
    const ModelInfo& info = appearance_model(g.appearance.model);
    GroupArrays<float>& residuals = g[Group::kResidual];
    if (residuals.width > 0 && !info.plain_sh)
        throw UsageError(
            fmt::format("the colours of the appearance '{}' cannot be turned; with --format ply --sh-projection they "
                        "become spherical harmonics, which can",
                        info.name));
    const int degree = residuals.width > 0 ? g.appearance.max_degree : 0;
    const Eigen::MatrixXd sh = degree > 0 ? sh_turn(rotation, degree) : Eigen::MatrixXd();
    const Eigen::Quaterniond q(rotation);
    parallel_for_rows(g.count, [&](std::int64_t i) {
        Eigen::Map<Eigen::Vector3f> mean(g[Group::kMean].param.data() + 3 * i);
        mean = (rotation * mean.cast<double>()).cast<float>();
        float* wxyz = g[Group::kRotation].param.data() + 4 * i;
        const Eigen::Quaterniond turned_q = q * Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
        wxyz[0] = float(turned_q.w()), wxyz[1] = float(turned_q.x()), wxyz[2] = float(turned_q.y()),
        wxyz[3] = float(turned_q.z());
        if (degree == 0 || i >= g.num_residuals()) return;
        // One row per basis function, one column per channel.
        Eigen::Map<Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor>> colors(
            residuals.param.data() + i * residuals.width, sh.rows(), 3);
        colors = (sh * colors.cast<double>()).cast<float>().eval();
    });
}

Camera turned(Camera camera, const Eigen::Matrix3d& rotation) {
    camera.rotation = camera.rotation * rotation.transpose();
    return camera;
}

}  // namespace gs
