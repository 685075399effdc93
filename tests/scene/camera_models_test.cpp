// SPDX-License-Identifier: Apache-2.0
// Every camera model: round trips, closed values, domains.
#include "lib/scene/camera_models.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace gs {
namespace {

using Eigen::Vector2d, Eigen::Vector3d;
using M = CameraModel;

struct Case {
    M model;
    std::vector<double> params;
};

/// Returns one strongly but sensibly distorted 640x480 camera per model.
const std::vector<Case>& cases() {
    static const std::vector<Case> list = {
        {M::kSimplePinhole, {500, 310, 245}},
        {M::kPinhole, {500, 520, 310, 245}},
        {M::kSimpleRadial, {500, 310, 245, -0.2}},
        {M::kRadial, {500, 310, 245, -0.25, 0.1}},
        {M::kOpenCV, {500, 520, 310, 245, -0.25, 0.1, 0.003, -0.002}},
        {M::kOpenCVFisheye, {300, 310, 310, 245, 0.02, -0.01, 0.003, -0.0005}},
        {M::kFullOpenCV, {500, 520, 310, 245, -0.2, 0.05, 0.002, -0.001, 0.01, 0.03, 0.02, 0.005}},
        {M::kFov, {300, 310, 310, 245, 0.9}},
        {M::kSimpleRadialFisheye, {300, 310, 245, -0.03}},
        {M::kRadialFisheye, {300, 310, 245, 0.05, -0.01}},
        {M::kThinPrismFisheye, {300, 310, 310, 245, 0.02, -0.01, 0.001, -0.002, 0.003, -0.0005, 0.002, -0.001}},
        {M::kRadTanThinPrismFisheye,
         {300, 310, 310, 245, 0.02, -0.01, 0.003, -0.001, 0.0002, 0.00001, 0.001, -0.002, 0.002, -0.001, 0.0015,
          0.0005}},
        {M::kSimpleDivision, {500, 310, 245, -0.15}},
        {M::kDivision, {500, 520, 310, 245, 0.1}},
        {M::kSimpleFisheye, {300, 310, 245}},
        {M::kFisheye, {300, 310, 310, 245}},
        {M::kEucm, {400, 410, 310, 245, 0.6, 1.1}},
        {M::kEquirectangular, {640, 480}},
    };
    return list;
}

LensCamera lens_of(const Case& c) { return make_lens_camera(c.model, 640, 480, c.params); }

TEST(CameraModels, TableIsCompleteAndOrdered) {
    ASSERT_EQ(camera_models().size(), 18u);
    ASSERT_EQ(cases().size(), 18u);
    const int expected_params[18] = {3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2};
    for (int i = 0; i < 18; ++i) {
        EXPECT_EQ(static_cast<int>(camera_models()[i].id), i);
        EXPECT_EQ(camera_models()[i].num_params(), expected_params[i]) << camera_models()[i].name;
        EXPECT_EQ(int(cases()[i].params.size()), expected_params[i]);
    }
}

TEST(CameraModels, PixelsSurviveTheWayToARayAndBack) {
    for (const Case& c : cases()) {
        const LensCamera lens = lens_of(c);
        double worst = 0;
        for (double y = 0.5; y < 480; y += 37)
            for (double x = 0.5; x < 640; x += 41) {
                const auto ray = unproject(lens, {x, y});
                ASSERT_TRUE(ray) << camera_model_info(c.model).name << " at " << x << ", " << y;
                const auto pixel = project(lens, 2.5 * *ray);
                ASSERT_TRUE(pixel) << camera_model_info(c.model).name << " at " << x << ", " << y;
                worst = std::max(worst, (*pixel - Vector2d(x, y)).norm());
            }
        EXPECT_LT(worst, 1e-9) << camera_model_info(c.model).name;
    }
}

TEST(CameraModels, RaysSurviveTheWayToAPixelAndBack) {
    for (const Case& c : cases()) {
        const LensCamera lens = lens_of(c);
        double worst = 0;
        for (double u = -0.55; u < 0.6; u += 0.11)
            for (double v = -0.4; v < 0.45; v += 0.1) {
                const Vector3d direction = Vector3d(u, v, 1).normalized();
                const auto pixel = project(lens, 7 * direction);
                ASSERT_TRUE(pixel) << camera_model_info(c.model).name;
                const auto ray = unproject(lens, *pixel);
                ASSERT_TRUE(ray) << camera_model_info(c.model).name;
                worst = std::max(worst, (ray->normalized() - direction).norm());
            }
        EXPECT_LT(worst, 1e-11) << camera_model_info(c.model).name;
    }
}

/// Compares with the definitions of COLMAP's models, written once more without the library's helpers.
TEST(CameraModels, KnownValues) {
    const double u = 0.3, v = -0.2, r2 = u * u + v * v, r = std::sqrt(r2), theta = std::atan(r);
    const auto at = [&](M model, std::vector<double> params) {
        return *project(make_lens_camera(model, 10, 10, params), {2 * u, 2 * v, 2});
    };
    const auto expect = [](const Vector2d& got, double x, double y) {
        EXPECT_NEAR(got.x(), x, 1e-12);
        EXPECT_NEAR(got.y(), y, 1e-12);
    };
    expect(at(M::kSimpleRadial, {2, 1, 5, 0.5}), 2 * u * (1 + 0.5 * r2) + 1, 2 * v * (1 + 0.5 * r2) + 5);
    const double radial = 1 + 0.1 * r2 + 0.2 * r2 * r2;
    expect(at(M::kOpenCV, {1, 1, 0, 0, 0.1, 0.2, 0.01, 0.02}), u * radial + 2 * 0.01 * u * v + 0.02 * (r2 + 2 * u * u),
           v * radial + 2 * 0.02 * u * v + 0.01 * (r2 + 2 * v * v));
    const double full =
        (1 + 0.1 * r2 + 0.2 * r2 * r2 + 0.3 * r2 * r2 * r2) / (1 + 0.4 * r2 + 0.5 * r2 * r2 + 0.6 * r2 * r2 * r2);
    expect(at(M::kFullOpenCV, {1, 1, 0, 0, 0.1, 0.2, 0, 0, 0.3, 0.4, 0.5, 0.6}), u * full, v * full);
    const double t2 = theta * theta,
                 fish = theta / r * (1 + 0.1 * t2 + 0.2 * t2 * t2 + 0.3 * t2 * t2 * t2 + 0.4 * t2 * t2 * t2 * t2);
    expect(at(M::kOpenCVFisheye, {1, 1, 0, 0, 0.1, 0.2, 0.3, 0.4}), u * fish, v * fish);
    expect(at(M::kFov, {1, 1, 0, 0, 0.8}), u * std::atan(2 * r * std::tan(0.4)) / (r * 0.8),
           v * std::atan(2 * r * std::tan(0.4)) / (r * 0.8));
    const double division = 2 / (1 + std::sqrt(1 + 4 * 0.3 * r2));
    expect(at(M::kDivision, {1, 1, 0, 0, -0.3}), u * division, v * division);
    const double eucm = 0.6 * std::sqrt(1.2 * r2 + 1) + 0.4;
    expect(at(M::kEucm, {1, 1, 0, 0, 0.6, 1.2}), u / eucm, v / eucm);
    const double tu = u * theta / r, tv = v * theta / r;
    const double prism = 1 + 0.1 * t2 + 0.2 * t2 * t2 + 0.3 * t2 * t2 * t2 + 0.4 * t2 * t2 * t2 * t2;
    expect(at(M::kThinPrismFisheye, {1, 1, 0, 0, 0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.05, 0.06}),
           tu * prism + 2 * 0.01 * tu * tv + 0.02 * (t2 + 2 * tu * tu) + 0.05 * t2,
           tv * prism + 2 * 0.02 * tu * tv + 0.01 * (t2 + 2 * tv * tv) + 0.06 * t2);
    // p0 = 0.01, p1 = 0.02, s = 0.03, 0.04, 0.05, 0.06; only k0 = 0.1.
    const double x = tu * (1 + 0.1 * t2), y = tv * (1 + 0.1 * t2), q = x * x + y * y;
    expect(at(M::kRadTanThinPrismFisheye, {1, 1, 0, 0, 0.1, 0, 0, 0, 0, 0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06}),
           x + 2 * 0.02 * x * y + 0.01 * (q + 2 * x * x) + 0.03 * q + 0.04 * q * q,
           y + 2 * 0.01 * x * y + 0.02 * (q + 2 * y * y) + 0.05 * q + 0.06 * q * q);
    expect(*project(make_lens_camera(M::kEquirectangular, 8, 4, std::vector<double>{8, 4}), {0, 0, -3}), 8, 2);
}

TEST(CameraModels, CentreOfTheLensIsThePrincipalPoint) {
    for (const Case& c : cases()) {
        if (c.model == M::kEquirectangular) continue;
        const LensCamera lens = lens_of(c);
        const auto pixel = project(lens, {0, 0, 1});
        ASSERT_TRUE(pixel);
        EXPECT_LT((*pixel - Vector2d(lens.cx, lens.cy)).norm(), 1e-12) << camera_model_info(c.model).name;
        EXPECT_LT((*unproject(lens, {lens.cx, lens.cy}) - Vector3d(0, 0, 1)).norm(), 1e-12);
    }
}

TEST(CameraModels, PointsBehindAndBeyondTheFoldHaveNoPixel) {
    const auto sees_behind = [](M model) {
        return is_fisheye(model) || model == M::kFov || model == M::kEucm || model == M::kEquirectangular ||
               model == M::kSimpleDivision || model == M::kDivision;
    };
    for (const Case& c : cases())
        if (!sees_behind(c.model)) {
            EXPECT_FALSE(project(lens_of(c), {0.1, 0.1, -1})) << camera_model_info(c.model).name;
            EXPECT_FALSE(project(lens_of(c), {0.1, 0.1, 0})) << camera_model_info(c.model).name;
        }
    // An equidistant fisheye sees around itself: 135 degrees to the right.
    const LensCamera fisheye = make_lens_camera(M::kFisheye, 100, 100, std::vector<double>{10, 10, 50, 50});
    const auto behind = project(fisheye, {1, 0, -1});
    ASSERT_TRUE(behind);
    EXPECT_NEAR(behind->x(), 50 + 10 * 0.75 * M_PI, 1e-12);
    EXPECT_LT((*unproject(fisheye, *behind) - Vector3d(1, 0, -1).normalized()).norm(), 1e-12);
    // r (1 - 0.2 r^2) turns back at r = 1.29 and could never reach 0.9.
    const LensCamera lens = make_lens_camera(M::kSimpleRadial, 100, 100, std::vector<double>{100, 50, 50, -0.2});
    EXPECT_TRUE(project(lens, {1.2, 0, 1}));
    EXPECT_FALSE(project(lens, {1.4, 0, 1}));
    EXPECT_FALSE(project(lens, {2.5, 0, 1})) << "on the other side, where it is one to one again";
    EXPECT_FALSE(unproject(lens, {50 + 90.0, 50}));
}

TEST(CameraModels, ScalingMovesPixelsPerAxis) {
    for (const Case& c : cases()) {
        const LensCamera lens = lens_of(c), half = scaled_to(lens, 320, 120);
        const auto a = project(lens, {0.2, -0.1, 1}), b = project(half, {0.2, -0.1, 1});
        ASSERT_TRUE(a && b);
        EXPECT_LT((Vector2d(a->x() / 2, a->y() / 4) - *b).norm(), 1e-11) << camera_model_info(c.model).name;
    }
}

TEST(CameraModels, OnlyUndistortedPerspectiveIsPinhole) {
    for (const Case& c : cases())
        EXPECT_EQ(is_pinhole(lens_of(c)), c.model == M::kSimplePinhole || c.model == M::kPinhole);
    EXPECT_TRUE(is_pinhole(make_lens_camera(M::kOpenCV, 9, 9, std::vector<double>{5, 5, 4, 4, 0, 0, 0, 0})));
    EXPECT_FALSE(is_pinhole(make_lens_camera(M::kOpenCVFisheye, 9, 9, std::vector<double>{5, 5, 4, 4, 0, 0, 0, 0})));
}

TEST(CameraModels, TheRangeOfALensEndsAtItsFoldOrAtItsImage) {
    const auto range = [](M model, std::vector<double> params) {
        return lens_range(make_lens_camera(model, 100, 100, params));
    };
    // The corners of the image, 15 % enlarged, are 0.65 sqrt(2) * 100 / 40 rad from the axis.
    const LensRange whole = range(M::kFisheye, {40, 40, 50, 50});
    EXPECT_FALSE(whole.folds);
    EXPECT_GT(whole.max_angle, 0.5 * std::sqrt(2.0) * 100 / 40) << "the corners of the image";
    EXPECT_LT(whole.max_angle, 0.66 * std::sqrt(2.0) * 100 / 40);
    EXPECT_NEAR(whole.slope, 1, 1e-9);
    // theta (1 - 0.1 theta^2) turns back at sqrt(1 / 0.3), and has a slope of 0.4 at sqrt(0.6 / 0.3).
    const LensRange folded = range(M::kSimpleRadialFisheye, {30, 50, 50, -0.1});
    EXPECT_TRUE(folded.folds);
    EXPECT_NEAR(folded.max_angle, std::sqrt(0.6 / 0.3), 1e-5);
    EXPECT_NEAR(folded.slope, 0.4, 1e-4);
    EXPECT_LT(range(M::kRadial, {10, 50, 50, 0.3, 0.2}).max_angle, M_PI / 2);
}

}  // namespace
}  // namespace gs
