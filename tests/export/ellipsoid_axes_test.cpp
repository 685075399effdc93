// SPDX-License-Identifier: Apache-2.0
// The 24 descriptions of an ellipsoid: all are the same one, and the chosen one comes back from its codes better than
// the plain one.
#include "lib/export/geometry_codes.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <random>

namespace gs {
namespace {

PackedGeometry ellipsoid(const std::array<double, 4>& rotation, const std::array<double, 3>& scale) {
    return {{0, 0, 0}, 1, {0, 0, 0}, scale, rotation};
}

/// Returns axes times standard deviations. The covariance is the product of this matrix with its transpose.
Eigen::Matrix3d axes(const std::array<double, 4>& rotation, const std::array<double, 3>& scale) {
    return Eigen::Quaterniond(rotation.data()).normalized().toRotationMatrix() *
           Eigen::Vector3d(scale.data()).asDiagonal();
}

Eigen::Matrix3d covariance(const PackedGeometry& g) {
    const Eigen::Matrix3d m = axes(g.rotation, g.scale);
    return m * m.transpose();
}

/// Returns the error of the covariance that the codes of the rotation leave, relative to the ellipsoid's own size in
/// each direction (at least a tenth of the largest).
double rotation_error(const PackedGeometry& g) {
    std::array<double, 3> thick = g.scale;
    for (double& s : thick) s = 1 / std::max({s, 0.1 * g.scale[0], 0.1 * g.scale[1], 0.1 * g.scale[2], 1e-100});
    const Eigen::Matrix3d whiten = Eigen::Vector3d(thick.data()).asDiagonal() *
                                   Eigen::Quaterniond(g.rotation.data()).normalized().toRotationMatrix().transpose();
    const Eigen::Matrix3d decoded = axes(decode_rotation(rotation_codes(g.rotation)), g.scale);
    return (whiten * (decoded * decoded.transpose() - covariance(g)) * whiten.transpose()).norm();
}

PackedGeometry chosen(PackedGeometry g) {
    choose_axes(g);
    return g;
}

const std::array<double, 3> kShapes[] = {{1, 0.3, 0.1}, {1, 1, 0.01}, {1, 1e-2, 1e-2},     {1, 1, 1},
                                         {0, 0, 0},     {1, 0, 0},    {1e-13, 1e-5, 1e13}, {1e13, 2e13, 1e13}};

TEST(EllipsoidAxes, DescribeTheSameEllipsoid) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    for (const auto& shape : kShapes) {
        for (int i = 0; i < 100; ++i) {
            const PackedGeometry plain =
                                     ellipsoid({normal(random), normal(random), normal(random), normal(random)}, shape),
                                 best = chosen(plain);
            EXPECT_LE((covariance(best) - covariance(plain)).norm(), 1e-12 * covariance(plain).norm());
            EXPECT_NEAR(Eigen::Vector4d(best.rotation.data()).norm(), 1, 1e-12);
        }
    }
}

TEST(EllipsoidAxes, ComeBackFromTheirCodesBetter) {
    std::mt19937 random(2);
    std::normal_distribution<double> normal;
    for (const auto& shape : kShapes) {
        SCOPED_TRACE(testing::Message() << shape[0] << ", " << shape[1] << ", " << shape[2]);
        double plain_sum = 0, best_sum = 0;
        for (int i = 0; i < 1000; ++i) {
            const PackedGeometry plain =
                ellipsoid({normal(random), normal(random), normal(random), normal(random)}, shape);
            const double error = rotation_error(plain), best = rotation_error(chosen(plain));
            EXPECT_LE(best, 1.2 * error + 1e-12) << "second order in the angle";
            plain_sum += error, best_sum += best;
        }
        EXPECT_LE(best_sum, 0.7 * plain_sum + 1e-9);
    }
}

TEST(EllipsoidAxes, OfASphereStayAsTheyAre) {
    const PackedGeometry best = chosen(ellipsoid({1, 2, 3, 4}, {1, 1, 1}));
    for (std::size_t k = 0; k < 4; ++k) EXPECT_DOUBLE_EQ(best.rotation[k], double(k + 1) / std::sqrt(30.0));
}

}  // namespace
}  // namespace gs
