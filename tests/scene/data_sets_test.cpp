// SPDX-License-Identifier: Apache-2.0
// The real datasets used for development: counts, sizes, and points that project to where the images show them.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>

#include "lib/scene/scene.h"
#include "tests/core/test_data.h"

namespace gs {
namespace {

#define GS_REQUIRE_DATA(variable, name)                 \
    const std::string variable = test::test_data(name); \
    if (variable.empty()) GTEST_SKIP() << "no " << name << " in GSAPP_TEST_DATA"

Scene load(const std::string& source, bool eval) {
    SceneOptions options;
    options.source = source;
    options.eval = eval;
    return load_scene(options);
}

/// Returns the share of the points that project into a view.
double visible_share(const Scene& scene, const Camera& camera) {
    int inside = 0;
    for (const Eigen::Vector3f& point : scene.points.positions) {
        const Eigen::Vector3d p = camera.rotation * point.cast<double>() + camera.translation;
        const double x = camera.fx * p.x() / p.z() + camera.cx, y = camera.fy * p.y() / p.z() + camera.cy;
        inside += p.z() > 0 && x >= 0 && y >= 0 && x < camera.width && y < camera.height;
    }
    return double(inside) / double(scene.points.positions.size());
}

/// Returns the mean absolute difference between the colours of points and the pixels they project to, over all views.
/// Points hidden behind others are included, so it is no small number, but a much smaller one than for wrong poses.
double color_error(const Scene& scene, double shift) {
    double sum = 0;
    std::int64_t count = 0;
    for (std::size_t v = 0; v < scene.train.size(); v += 5) {
        const View& view = scene.train[v];
        const Image image = view.load().color;
        for (std::size_t i = 0; i < scene.points.positions.size(); ++i) {
            const Eigen::Vector3d p =
                view.camera.rotation * scene.points.positions[i].cast<double>() + view.camera.translation;
            if (p.z() <= 0) continue;
            const int x = int(std::floor(view.camera.fx * p.x() / p.z() + view.camera.cx + shift)),
                      y = int(std::floor(view.camera.fy * p.y() / p.z() + view.camera.cy));
            if (x < 0 || y < 0 || x >= image.width || y >= image.height) continue;
            for (int c = 0; c < 3; ++c) sum += std::abs(image.value(x, y, c) - scene.points.colors[i][c]);
            count += 3;
        }
    }
    return sum / double(count);
}

TEST(DataSets, TinyLego) {
    GS_REQUIRE_DATA(path, "tiny/lego");
    const Scene scene = load(path, true);
    EXPECT_EQ(scene.kind, "nerf-synthetic");
    EXPECT_EQ(scene.train.size(), 40u);
    EXPECT_EQ(scene.test.size(), 10u);
    EXPECT_TRUE(scene.has_alpha);
    EXPECT_TRUE(scene.notes.empty()) << scene.notes[0];
    for (const View& view : scene.train) {
        EXPECT_EQ(view.camera.width, 100);
        EXPECT_NEAR(view.camera.fx, 138.888879, 1e-5);
        EXPECT_NEAR(view.camera.center().norm(), 4.0311, 1e-3);
        // All cameras look at the origin.
        const Eigen::Vector3d origin = view.camera.translation;
        EXPECT_GT(origin.z(), 3.9);
    }
    const ViewImage image = scene.train[0].load();
    EXPECT_EQ(image.color.channels, 4);
    EXPECT_EQ(image.color.value(0, 0, 3), 0) << "the corner shows the background";
    EXPECT_EQ(image.color.value(50, 50, 3), 1) << "the middle shows the model";
    EXPECT_EQ(load(path, false).train.size(), 50u);
}

TEST(DataSets, TinyBonsai) {
    GS_REQUIRE_DATA(path, "tiny/bonsai");
    const Scene scene = load(path, true);
    EXPECT_EQ(scene.kind, "colmap");
    EXPECT_EQ(scene.train.size(), 52u);
    EXPECT_EQ(scene.test.size(), 8u);
    EXPECT_EQ(scene.points.positions.size(), 6000u);
    EXPECT_TRUE(scene.notes.empty()) << scene.notes[0];
    const Camera& camera = scene.train[0].camera;
    EXPECT_EQ(camera.width, 200);
    EXPECT_EQ(camera.height, 133);
    EXPECT_NEAR(camera.fx, 205.732, 1e-3);
    for (const View& view : scene.train) EXPECT_GT(visible_share(scene, view.camera), 0.1) << view.name;
    EXPECT_LT(color_error(scene, 0), 0.8 * color_error(scene, 10)) << "points and pixels do not fit";
}

TEST(DataSets, Fox) {
    GS_REQUIRE_DATA(path, "fox");
    const Scene scene = load(path, true);
    EXPECT_EQ(scene.train.size(), 43u);
    EXPECT_EQ(scene.test.size(), 7u);
    EXPECT_EQ(scene.points.positions.size(), 12445u);
    EXPECT_NEAR(scene.train[0].camera.cx, 274.448, 1e-3) << "not the image centre";
    EXPECT_EQ(scene.train[0].camera.height, 949);
    for (const View& view : scene.train) EXPECT_GT(visible_share(scene, view.camera), 0.1) << view.name;
    EXPECT_LT(color_error(scene, 0), 0.8 * color_error(scene, 30));
}

TEST(DataSets, FoxDistortedBecomesTheSamePinholeAsColmapMadeOfIt) {
    GS_REQUIRE_DATA(path, "fox_distorted");
    const Scene scene = load(path, false);
    EXPECT_EQ(scene.kind, "transforms");
    EXPECT_EQ(scene.train.size(), 50u);
    const Camera& camera = scene.train[0].camera;
    EXPECT_NEAR(camera.fx, 687.76, 1e-9);
    // ../fox is COLMAP's undistortion of these photographs with its own, very similar calibration: 533x949.
    EXPECT_NEAR(camera.width, 533, 3);
    EXPECT_NEAR(camera.height, 949, 3);
    const ViewImage image = scene.train[0].load();
    EXPECT_EQ(image.color.width, camera.width);
    EXPECT_FALSE(image.mask);
    bool told = false;
    for (const std::string& note : scene.notes)
        told = told || note.find("50 images with lens distortion") != std::string::npos;
    EXPECT_TRUE(told);

    GS_REQUIRE_DATA(pinhole, "fox");
    const Scene reference = load(pinhole, false);
    const Image theirs = reference.train[0].load().color;
    ASSERT_EQ(std::filesystem::path(reference.train[0].name).filename(),
              std::filesystem::path(scene.train[0].name).filename());
    double difference = 0, shifted = 0;
    int count = 0;
    for (int y = 40; y < 900; y += 3)
        for (int x = 40; x < 490; x += 3, ++count) {
            // Same ray in both cameras.
            const Camera& other = reference.train[0].camera;
            const double u = (x + 0.5 - camera.cx) / camera.fx, v = (y + 0.5 - camera.cy) / camera.fy;
            const int ox = int(other.fx * u + other.cx), oy = int(other.fy * v + other.cy);
            difference += std::abs(image.color.value(x, y, 1) - theirs.value(ox, oy, 1));
            shifted += std::abs(image.color.value(x, y, 1) - theirs.value(ox + 4, oy, 1));
        }
    EXPECT_LT(difference / count, 0.02);
    EXPECT_LT(difference, 0.5 * shifted);
}

}  // namespace
}  // namespace gs
