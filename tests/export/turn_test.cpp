// SPDX-License-Identifier: Apache-2.0
// A turned model seen from the turned camera is the model.
#include "lib/export/turn.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <cmath>
#include <random>

#include "appearance/sh_basis.h"
#include "kernels/base/error.h"
#include "lib/export/geometry_codes.h"
#include "lib/export/sh_projection.h"
#include "lib/scene/camera_params.h"
#include "tests/io/file_helpers.h"
#include "tests/kernels/backends.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

const Eigen::Matrix3d kOblique = Eigen::AngleAxisd(2.1, Eigen::Vector3d(0.3, -0.8, 0.5).normalized()).matrix();

/// A camera at `position` that looks at the origin; `up` need not be perpendicular.
Camera camera_at(const Eigen::Vector3d& position, const Eigen::Vector3d& up) {
    Camera camera;
    camera.width = 64, camera.height = 48;
    camera.fx = camera.fy = 60, camera.cx = 31, camera.cy = 25;
    const Eigen::Vector3d forward = -position.normalized(), right = forward.cross(up).normalized();
    camera.rotation.row(0) = right, camera.rotation.row(1) = forward.cross(right), camera.rotation.row(2) = forward;
    camera.translation = -camera.rotation * position;
    return camera;
}

RenderedImage rendered(const Gaussians& g, const Camera& camera) {
    const auto backend = make_cpu_backend(g.appearance);
    backend->upload(g);
    RenderRequest request;
    request.camera = camera_params(camera);
    request.background = {0.25f, 0.5f, 0.75f};
    RenderedImage image;
    backend->render(request, image);
    return image;
}

TEST(Turn, CoefficientsFollowTheFunction) {
    const auto at = sphere_directions(50, 0.7);
    for (const int degree : {1, 2, 3}) {
        const Eigen::MatrixXd m = sh_turn(kOblique, degree);
        ASSERT_EQ(m.rows(), (degree + 1) * (degree + 1) - 1);
        EXPECT_LE((m * m.transpose() - Eigen::MatrixXd::Identity(m.rows(), m.rows())).norm(), 1e-12)
            << "rotations keep the basis orthonormal";
        double worst = 0;
        for (const Vec3<double>& d : at) {
            const Eigen::Vector3d t = kOblique * Eigen::Vector3d(d.x, d.y, d.z);
            Eigen::VectorXd y(m.rows()), y_turned(m.rows());
            appearance::ShBasis::basis(d, degree, y.data());
            appearance::ShBasis::basis(Vec3<double>{t.x(), t.y(), t.z()}, degree, y_turned.data());
            worst = std::max(worst, (m.transpose() * y_turned - y).cwiseAbs().maxCoeff());
        }
        EXPECT_LE(worst, 1e-12) << degree;
    }
}

TEST(Turn, PicturesFromTurnedCamerasAreTheSame) {
    for (const int degree : {0, 1, 2, 3}) {
        Gaussians g = random_gaussians(120, {degree ? "sh" : "none", degree, ColorActivation::kRelu});
        for (float& x : g[Group::kScale].param) x = 0.4f * x - 2;
        const Camera camera = camera_at({1.5, -4, 2}, Eigen::Vector3d::UnitZ());
        const RenderedImage before = rendered(g, camera);
        Gaussians after = g;
        turn(after, kOblique);
        const RenderedImage image = rendered(after, turned(camera, kOblique)), unturned = rendered(after, camera);
        double difference = 0, other = 0, contrast = 0;
        int above = 0;
        for (std::size_t i = 0; i < before.rgb.size(); ++i) {
            const double d = std::abs(image.rgb[i] - before.rgb[i]);
            difference += d / double(before.rgb.size());
            above += d > 1e-3;
            other = std::max(other, double(std::abs(unturned.rgb[i] - before.rgb[i])));
            contrast = std::max(contrast, double(std::abs(before.rgb[i] - before.rgb[0])));
        }
        // Rounding decides in a few pixels whether a fragment is above 1/255, or which of two is in front.
        EXPECT_LE(difference, 2e-6) << degree;
        EXPECT_LE(above, int(before.rgb.size()) / 500) << degree;
        EXPECT_GT(other, 0.1) << "another camera sees something else";
        EXPECT_GT(contrast, 0.1);
        std::printf("degree %d: mean difference %.1e, %d of %d values by more than 0.001\n", degree, difference, above,
                    int(before.rgb.size()));
    }
}

TEST(Turn, ModelsWithoutHarmonicsAreRefused) {
    for (const ModelInfo* model : appearance_models()) {
        Gaussians g = random_gaussians(3, {model->name, model->default_max_degree, ColorActivation::kRelu});
        if (g[Group::kResidual].width == 0 || model->plain_sh) {
            EXPECT_NO_THROW(turn(g, kOblique)) << model->name;
        } else {
            EXPECT_CONTAINS(message_of<UsageError>([&] { turn(g, kOblique); }), "--sh-projection");
        }
    }
}

TEST(Turn, MixedModelsTurnTheResidualsTheyHave) {
    Gaussians all = random_gaussians(5, {"sh", 2, ColorActivation::kRelu}), some = all;
    some[Group::kResidual].param.resize(std::size_t(2 * some[Group::kResidual].width));
    turn(all, kOblique);
    turn(some, kOblique);
    EXPECT_EQ(some[Group::kMean].param, all[Group::kMean].param);
    EXPECT_TRUE(std::equal(some[Group::kResidual].param.begin(), some[Group::kResidual].param.end(),
                           all[Group::kResidual].param.begin()));
}

TEST(Turn, LevelCamerasSayWhichWayIsUp) {
    const Eigen::Vector3d up = Eigen::Vector3d(0.1, 0.2, 0.9).normalized();
    // All on one side and above: their mean up leans to the other side.
    std::vector<Camera> cameras;
    for (const Eigen::Vector3d& position :
         {Eigen::Vector3d(3, 0.2, 3), Eigen::Vector3d(3, 2, 2.5), Eigen::Vector3d(2.5, -2, 3)})
        cameras.push_back(camera_at(position, up));
    EXPECT_LE((up_direction(cameras) - up).norm(), 1e-9);
    // Side by side, the mean decides: only it says how far they lean.
    std::vector<Camera> row(2, camera_at({4, 0, 1}, Eigen::Vector3d::UnitZ()));
    EXPECT_LE((up_direction(row) + row[0].rotation.row(1).transpose()).norm(), 1e-9);
    EXPECT_THROW(up_direction({}), UsageError);
}

TEST(Turn, PhotographsThatLieOnTheirSideSayWhichWayIsUp) {
    const Eigen::Vector3d up = Eigen::Vector3d(0.1, 0.2, 0.9).normalized(), side = up.unitOrthogonal();
    for (const double height : {0.0, 0.5, 1.5, 3.0}) {
        for (const bool lies : {false, true}) {
            std::vector<Camera> cameras;
            for (int i = 0; i < 12; ++i) {
                const Eigen::Vector3d around = Eigen::AngleAxisd(0.5 * i, up) * side;
                Camera camera = camera_at(3 * around + height * up, up);
                const Eigen::Matrix3d as_it_is = camera.rotation;
                if (lies) camera.rotation.row(0) = as_it_is.row(1), camera.rotation.row(1) = -as_it_is.row(0);
                cameras.push_back(camera);
            }
            const auto found = find_up(cameras);
            ASSERT_TRUE(found);
            const double cosine = lies && height == 0 ? std::abs(found->dot(up)) : found->dot(up);
            EXPECT_GT(cosine, 0.999) << height << (lies ? ", lying" : "");
        }
    }
    EXPECT_FALSE(find_up({}));
}

TEST(Turn, TakesUpToTheAxis) {
    const Eigen::Vector3d y = Eigen::Vector3d::UnitY(), z = Eigen::Vector3d::UnitZ();
    for (const Eigen::Vector3d& axis : {y, z, Eigen::Vector3d(-y)}) {
        for (const Eigen::Vector3d& up : {y, z, Eigen::Vector3d(-y), Eigen::Vector3d(-z), Eigen::Vector3d(-1, 0, 0),
                                          Eigen::Vector3d(0.1, -0.9, 0.2).normalized()}) {
            const Eigen::Matrix3d rotation = turn_to(up, axis);
            EXPECT_LE((rotation * up - axis).norm(), 1e-12);
            EXPECT_LE((rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-12);
            EXPECT_NEAR(rotation.determinant(), 1, 1e-12);
        }
    }
    EXPECT_EQ(turn_to(y, y), Eigen::Matrix3d::Identity());
    EXPECT_EQ(turn_to(z, y) * Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(1, 3, -2));
    EXPECT_EQ(turn_to(-y, y) * Eigen::Vector3d(1, 2, 3), Eigen::Vector3d(1, -2, -3));
}

// The 24 descriptions of an ellipsoid: all are the same one, and the chosen one comes back from its codes better than
// the plain one.

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
}  // namespace gs::test
