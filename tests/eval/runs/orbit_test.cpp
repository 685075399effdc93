// SPDX-License-Identifier: Apache-2.0
// Orbits: what the training cameras decide, and what the user does.
#include "apps/gsapp/render/orbit.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "kernels/base/error.h"
#include "tests/eval/runs/ring.h"

namespace gs {
namespace {

using Eigen::Vector3d;

/// The angle between a direction and the plane that the cameras' mean upward direction is perpendicular to.
double elevation(const Vector3d& offset, const std::vector<View>& views) {
    Vector3d up = Vector3d::Zero();
    for (const View& view : views) up -= view.camera.rotation.row(1).transpose();
    return std::asin(offset.normalized().dot(up.normalized())) * 180 / M_PI;
}

void expect_looks_at(const Camera& camera, const Vector3d& target, double tolerance) {
    const Vector3d seen = camera.rotation * target + camera.translation;
    EXPECT_NEAR(seen.head<2>().norm(), 0, tolerance);
    EXPECT_GT(seen.z(), 0);
    EXPECT_NEAR(camera.rotation.determinant(), 1, 1e-9);
    EXPECT_NEAR((camera.rotation * camera.rotation.transpose() - Eigen::Matrix3d::Identity()).norm(), 0, 1e-9);
}

TEST(Orbit, OfARingIsTheRing) {
    const auto views = ring();
    const Vector3d target(1, 2, 0.5);
    for (const Camera& camera : orbit_path(views, {.count = 7}, {})) {
        EXPECT_NEAR((camera.center() - target).norm(), 4, 0.2);
        expect_looks_at(camera, target, 0.05);
        EXPECT_LT((camera.rotation * Vector3d(0, 0, 1)).y(), -0.5) << "world up points up in the picture";
        EXPECT_EQ(camera.width, views[0].camera.width);
    }
    EXPECT_THROW(orbit_path({}, {.count = 7}, {}), UsageError);
    EXPECT_THROW(orbit_path(views, {.count = 0}, {}), UsageError);
    EXPECT_TRUE(orbit_path({views[0]}, {.count = 3}, {})[2].translation.allFinite());
}

TEST(Orbit, HasTheRadiusElevationAndTargetThatAreAsked) {
    const auto views = ring();
    const Frame frame{{10, 20, 30}, 0.25};  // the views are in it
    const Vector3d usual = orbit_path(views, {.count = 1}, frame)[0].center() - Vector3d(1, 2, 0.5);
    const auto offset = [&](OrbitShape shape) {
        shape.count = 5;
        const Vector3d target = shape.target ? frame.from_scene(*shape.target) : Vector3d(1, 2, 0.5);
        const Camera camera = orbit_path(views, shape, frame)[2];
        expect_looks_at(camera, target, 0.05);
        return Vector3d(camera.center() - target);
    };
    EXPECT_NEAR(offset({.radius = {2, true}}).norm(), 2 * usual.norm(), 0.1) << "twice the usual distance";
    const auto angle = [&](const OrbitShape& shape) { return elevation(offset(shape), views); };
    EXPECT_NEAR(angle({.radius = {2, true}}), elevation(usual, views), 1) << "which keeps the elevation";
    EXPECT_NEAR(offset({.radius = {40, false}}).norm(), 10, 0.1) << "40 scene units are 10 of the frame";
    EXPECT_NEAR(angle({.elevation = -20.0}), -20, 1);
    EXPECT_NEAR(offset({.elevation = -20.0}).norm(), usual.norm(), 0.1) << "which keeps the distance";
    EXPECT_NEAR(angle({.elevation = 89.0}), 89, 1);
    // The target is in scene coordinates; from there the mean distance of the cameras counts.
    const Vector3d aside = offset({.radius = {8, false}, .elevation = 0.0, .target = Vector3d(16, 30, 33)});
    EXPECT_NEAR(aside.norm(), 2, 1e-9);
    EXPECT_NEAR(elevation(aside, views), 0, 1e-9);
    // Cameras on the axis above the target, and a target where a camera stands.
    EXPECT_TRUE(orbit_path({views[0]}, {.count = 3, .target = frame.to_scene(views[0].camera.center())}, frame)[1]
                    .translation.allFinite());
}

TEST(Orbit, GoesAroundAModelWithoutCameras) {
    Gaussians model;
    model.count = 5;
    model[Group::kMean] = {3, {4, 0, 0, 6, 0, 0, 5, 1, 0, 5, -1, 0, 5, 0, 0}, {}, {}};
    const Frame frame{{10, 20, 30}, 0.25};
    OrbitShape shape{.count = 4};
    const View view = usual_view(model, shape, frame);
    EXPECT_EQ(view.camera.width, 1280);
    EXPECT_LT(view.camera.center().z(), -2) << "where -y is up, the front faces -z";
    ASSERT_TRUE(shape.target && shape.up);
    EXPECT_NEAR((frame.from_scene(*shape.target) - Vector3d(5, 0, 0)).norm(), 0, 1e-9) << "the median";
    for (const Camera& camera : orbit_path({view}, shape, frame)) {
        expect_looks_at(camera, {5, 0, 0}, 1e-6);
        EXPECT_NEAR((camera.center() - Vector3d(5, 0, 0)).norm(), 3, 1e-9) << "the median distance is 1";
        EXPECT_LT(camera.center().y(), -1) << "-y is up";
    }
    OrbitShape other{.count = 2, .elevation = 0.0, .target = Vector3d(10, 20, 34), .up = Vector3d::UnitZ()};
    const View aside = usual_view(model, other, frame);
    for (const Camera& camera : orbit_path({aside}, other, frame)) {
        expect_looks_at(camera, {0, 0, 1}, 1e-6);
        EXPECT_NEAR(camera.center().z(), 1, 1e-9) << "level";
    }
    OrbitShape around_nothing;
    EXPECT_TRUE(usual_view({}, around_nothing, {}).camera.translation.allFinite()) << "nothing has a view, too";
    // "Up" can be chosen where there are cameras, too.
    const Camera turned = orbit_path(ring(), {.count = 1, .elevation = 90 - 1e-3, .up = -Vector3d::UnitX()}, {})[0];
    EXPECT_LT(turned.center().x(), -1);
}

TEST(Orbit, ReadsRadiusAndTarget) {
    EXPECT_EQ(parse_orbit_radius("2.5").value, 2.5);
    EXPECT_FALSE(parse_orbit_radius("2.5").is_factor);
    EXPECT_TRUE(parse_orbit_radius("1.5x").is_factor);
    for (const char* text : {"", "x", "0", "-1", "nan", "inf", "1e300", "1x2", "2 ", " 2", "0x"})
        EXPECT_THROW(parse_orbit_radius(text), UsageError) << text;
    EXPECT_EQ(parse_orbit_target("-1,0.5,3e2"), Vector3d(-1, 0.5, 300));
    EXPECT_EQ(parse_axis("z"), Vector3d(0, 0, 1));
    EXPECT_EQ(parse_axis("-x"), Vector3d(-1, 0, 0));
    for (const char* text : {"", "-", "w", "xy", "-yz", "--y", "y "})
        EXPECT_THROW(parse_axis(text), UsageError) << text;
    for (const char* text : {"", "1,2", "1,2,3,4", "1,2,nan", "inf,0,0", "1;2;3", "1,2,3 ", "1,,3", "1e99,0,0"})
        EXPECT_THROW(parse_orbit_target(text), UsageError) << text;
}

}  // namespace
}  // namespace gs
