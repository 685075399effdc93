// SPDX-License-Identifier: Apache-2.0
// The frame of a scene: its choice, cameras and points in it, and what is said of scenes that do not fit.
#include "lib/scene/frame.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;
using Eigen::Vector3d;

/// Camera centres on a circle: their size is 1.1 times its radius.
std::vector<Vector3d> ring(double radius, const Vector3d& center = Vector3d::Zero()) {
    std::vector<Vector3d> centers;
    for (int i = 0; i < 8; ++i)
        centers.push_back(center + radius * Vector3d(std::cos(i * M_PI / 4), std::sin(i * M_PI / 4), 0));
    return centers;
}

TEST(Frame, UsualScenesKeepTheirCoordinates) {
    EXPECT_TRUE(choose_frame({}, {}).is_identity());
    EXPECT_TRUE(choose_frame(ring(4.75 / 1.1), {}).is_identity());
    EXPECT_TRUE(choose_frame(ring(4.1 / 1.1, {10, 20, 30}), {{0, 0, 0}}).is_identity());
    EXPECT_TRUE(choose_frame(ring(5.9 / 1.1), {}).is_identity());
}

TEST(Frame, OthersGetTheUsualSize) {
    for (const double size : {1e-9, 1e-6, 1e-3, 1.0, 100.0, 1e3, 1e6, 1e9}) {
        const Frame frame = choose_frame(ring(size / 1.1), {});
        EXPECT_NEAR(frame.scale * size, 4.75, 1e-9) << size;
        EXPECT_TRUE(frame.center.isZero(0)) << size;
    }
}

TEST(Frame, MapCoordinatesAreCentred) {
    const Vector3d place(5e5, 4e6, 100);
    const Frame frame = choose_frame(ring(5 / 1.1, place), {});
    EXPECT_EQ(frame.scale, 1);
    EXPECT_LT((frame.center - place).norm(), 4 * std::sqrt(3.0));
    EXPECT_EQ(frame.center, Vector3d(frame.center.array().round())) << "a whole number, which files state shortly";
    const Frame small = choose_frame(ring(1e-3, place), {});
    EXPECT_LT(small.scale * (small.center - place).norm(), 4.75 * std::sqrt(3.0));
}

TEST(Frame, CamerasNearlyInOnePlaceLeaveTheSizeToThePoints) {
    EXPECT_NEAR(choose_frame(ring(1e-9), {{0, 0, 2e4}, {0, 2e4, 0}, {2e4, 0, 0}}).scale, 4.75 / (2e4 / 50), 1e-9);
    EXPECT_TRUE(choose_frame({{1, 2, 3}}, {}).is_identity());
    // These differ by rounding alone.
    EXPECT_EQ(choose_frame({{4e6 / 3, 0, 0}, {std::nextafter(4e6 / 3, 0), 0, 0}}, {}).scale, 1);
}

TEST(Frame, OneWrongPoseDoesNotMoveTheOthers) {
    std::vector<Vector3d> centers;
    for (const Vector3d& c : ring(4.5)) centers.insert(centers.end(), {c, -c, c});
    EXPECT_TRUE(choose_frame(centers, {}).is_identity());
    centers.push_back({500, -3000, 20});
    EXPECT_TRUE(choose_frame(centers, {}).is_identity());
}

TEST(Frame, ValuesThatAreNotFiniteDoNotCount) {
    const double nan = std::nan(""), inf = INFINITY;
    std::vector<Vector3d> centers = ring(100);
    centers.insert(centers.end(), {{nan, 0, 0}, {inf, 0, 0}, {1e300, 0, 0}});
    EXPECT_NEAR(choose_frame(centers, {{nan, nan, nan}}).scale, 4.75 / 110.0, 1e-12);
    EXPECT_TRUE(choose_frame({{nan, 0, 0}}, {}).is_identity());
}

TEST(Frame, CamerasGoThereAndBack) {
    const Frame frame{{5e5, -4e6, 7}, 0.02};
    Camera camera;
    camera.rotation = Eigen::AngleAxisd(0.7, Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    const Vector3d position(500010, -4000020, 3);
    camera.translation = -camera.rotation * position;
    const Camera inside = into_frame(camera, frame);
    EXPECT_NEAR((inside.center() - frame.from_scene(position)).norm(), 0, 1e-9);
    EXPECT_NEAR((out_of_frame(inside, frame).center() - position).norm(), 0, 1e-6);
    EXPECT_EQ(into_frame(camera, {}).translation, camera.translation);
}

TEST(Frame, TextIsReadBackExactly) {
    const Frame frame{{1.0 / 3, -4e6, 1e-9}, 0.1};
    const auto back = parse_frame(frame_text(frame));
    ASSERT_TRUE(back);
    EXPECT_EQ(back->center, frame.center);
    EXPECT_EQ(back->scale, frame.scale);
    for (const char* text : {"", "center 0 0 0 scale 0", "center 0 0 0 scale nan", "center inf 0 0 scale 1",
                             "center 0 0 scale 1", "center 0 0 0 scale 1 2", "scale 1", "center 0 0 0 scale 1e40"})
        EXPECT_FALSE(parse_frame(text)) << text;
}

TEST(Frame, FilesKeepAnOffsetWhereFloatsAreTooCoarse) {
    EXPECT_TRUE(file_offset({{100, 0, 0}, 1}).isZero(0));
    EXPECT_EQ(file_offset({{5e5, 0, 0}, 1}), Vector3d(5e5, 0, 0));
    EXPECT_TRUE(file_offset({{5e5, 0, 0}, 1e-3}).isZero(0)) << "a scene of 5 km at 500 km";
}

/// Writes the COLMAP scene of three images whose cameras and points are scaled and moved.
void write_moved_scene(const std::filesystem::path& folder, double scale, const Vector3d& offset) {
    auto images = row_of_images({"a.png", "b.png", "c.png"});
    for (std::size_t i = 0; i < images.size(); ++i)
        for (std::size_t k = 0; k < 3; ++k)  // the cameras have no rotation
            images[i].pose[4 + k] = scale * images[i].pose[4 + k] * (k == 0 ? 40 : 1) - offset[Eigen::Index(k)];
    const auto at = [&](std::uint64_t id, double x, double y, double z) {
        return TestPoint{id, scale * x + offset.x(), scale * y + offset.y(), scale * z + offset.z(), 1, 2, 3, 0};
    };
    write_model(folder / "sparse/0", {TestCamera{}}, images, {at(1, 0, 0, 0), at(2, -4, 0.25, 0.5), at(3, -8, 0, 1)});
    for (const char* name : {"a.png", "b.png", "c.png"}) write_png(folder / "images" / name);
}

Scene load(const std::filesystem::path& folder) {
    SceneOptions options;
    options.source = folder.string();
    return load_scene(options);
}

TEST(Frame, ScenesOfAnyUnitAndPlaceAreTheSameInTheirFrames) {
    TempFolder folder;
    write_moved_scene(folder / "original", 1, Vector3d::Zero());
    const Scene original = load(folder / "original");
    EXPECT_TRUE(original.frame.is_identity());
    int number = 0;
    for (const double scale : {1e-6, 1e-3, 1.0, 1e3, 1e6}) {
        for (const Vector3d& offset : {Vector3d(0, 0, 0), Vector3d(1e3, 1e3, 1e3), Vector3d(5e5, 4e6, 100)}) {
            const auto path = folder / std::to_string(number++);
            write_moved_scene(path, scale, offset);
            const Scene scene = load(path);
            EXPECT_NEAR(scene.extent / 5, 1, 0.15);
            const double ratio = scene.extent / original.extent;  // both are near the usual size
            const Vector3d shift = scene.train[0].camera.center() - ratio * original.train[0].camera.center();
            for (std::size_t v = 0; v < 3; ++v)
                EXPECT_LT((scene.train[v].camera.center() - ratio * original.train[v].camera.center() - shift).norm(),
                          2e-3)
                    << scale << " " << offset.transpose();
            for (std::size_t p = 0; p < 3; ++p) {
                const Vector3d here = scene.points.positions[p].cast<double>(),
                               there = original.points.positions[p].cast<double>();
                EXPECT_LT((here - ratio * there - shift).norm(), 2e-3) << scale << " " << offset.transpose();
            }
            EXPECT_TRUE(scene.notes.empty()) << scene.notes[0];
        }
    }
}

TEST(Frame, TheCallersFrameIsUsed) {
    TempFolder folder;
    write_moved_scene(folder.path(), 1e3, Vector3d::Zero());
    SceneOptions options;
    options.source = folder.path().string();
    EXPECT_NEAR(load_scene(options, {.frame = Frame{{0, 0, 0}, 1}}).train[1].camera.center().x(), -4000, 1e-9);
}

TEST(Frame, PointsBeforeTheNearPlaneAndBlindCamerasAreReported) {
    TempFolder folder;
    auto images = row_of_images({"a.png", "b.png", "c.png"});
    for (std::size_t i = 0; i < 3; ++i) images[i].pose = {1, 0, 0, 0, 0.4 * double(i), 0, 4};
    images[2].pose[6] = -100;  // all points are behind this camera
    write_model(folder / "sparse/0", {TestCamera{}}, images,
                {{1, 0, 0, 0, 1, 2, 3, 0}, {2, 0, 0, -3.999, 1, 2, 3, 0}, {3, 0.01, 0, 0, 1, 2, 3, 0}});
    for (const char* name : {"a.png", "b.png", "c.png"}) write_png(folder / "images" / name);
    const Scene scene = load(folder.path());
    EXPECT_TRUE(mentions(scene.notes, "1 of 3 points lie in images only nearer than"));
    EXPECT_TRUE(mentions(scene.notes, "1 of 3 cameras see none of the 3 points (c.png)"));
}

TEST(Frame, CamerasInOnePlaceAreReported) {
    TempFolder folder;
    auto images = row_of_images({"a.png", "b.png"});
    images[1].pose = images[0].pose;
    write_model(folder / "sparse/0", {TestCamera{}}, images, {{1, 0, 0, 0, 1, 2, 3, 0}, {2, 0.5, 0, 0, 1, 2, 3, 0}});
    for (const char* name : {"a.png", "b.png"}) write_png(folder / "images" / name);
    EXPECT_TRUE(mentions(load(folder.path()).notes, "all 2 cameras stand in one place"));
}

/// Writes a NeRF-synthetic scene whose cameras look at the middle of a cube.
void write_cube_scene(const std::filesystem::path& folder, double scale, const Vector3d& offset, double sign = 1) {
    std::string frames;
    for (int i = 0; i < 4; ++i) {
        const double a = i * M_PI / 2, c = std::cos(a), s = std::sin(a);
        const Vector3d center = scale * 4.0311 * Vector3d(c, s, 0) + offset;
        // OpenGL axes: z points away from the target, x along the ring.
        frames += fmt::format(
            "{}{{\"file_path\": \"./train/r_{}\", \"transform_matrix\": "
            "[[{},0,{},{}],[{},0,{},{}],[0,{},0,{}],[0,0,0,1]]}}",
            i > 0 ? "," : "", i, -s, sign * c, center.x(), c, sign * s, center.y(), sign, center.z());
        write_png(folder / fmt::format("train/r_{}.png", i), 16, 12, 4);
    }
    spit(folder / "transforms_train.json", "{\"camera_angle_x\": 0.8, \"frames\": [" + frames + "]}");
}

TEST(Frame, TheCubeOfSyntheticScenesFollowsThem) {
    TempFolder folder;
    write_cube_scene(folder / "usual", 1, Vector3d::Zero());
    const Scene usual = load(folder / "usual");
    EXPECT_EQ(usual.random_init_half_extent, 1.5);
    EXPECT_TRUE(usual.random_init_center.isZero(0));
    write_cube_scene(folder / "small", 0.7, Vector3d::Zero());
    const Scene small = load(folder / "small");
    EXPECT_NEAR(small.random_init_half_extent / small.frame.scale, 0.7 * 1.5, 1e-3);
    write_cube_scene(folder / "outward", 0.5, Vector3d::Zero(), -1);
    EXPECT_TRUE(load(folder / "outward").random_init_center.isZero(0)) << "they look away from the place they share";
    write_cube_scene(folder / "far", 1e3, {5e5, 4e6, 100});
    const Scene far = load(folder / "far");
    EXPECT_NEAR(far.random_init_half_extent / far.extent, usual.random_init_half_extent / usual.extent, 1e-3);
    EXPECT_LT((far.frame.to_scene(far.random_init_center) - Vector3d(5e5, 4e6, 100)).norm(), 1);
}

}  // namespace
}  // namespace gs
