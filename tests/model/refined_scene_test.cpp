// SPDX-License-Identifier: Apache-2.0
// Learned cameras written as a scene and loaded again, as a COLMAP model and as transforms.json.
#include "lib/model/refined_scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "tests/core/temporary_folder.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

/// Changes the training cameras as refining does.
void move_cameras(Scene& scene) {
    for (View& view : scene.train) {
        view.given = std::make_shared<const Camera>(view.camera);
        Camera& camera = view.camera;
        const Eigen::Vector3d center = camera.center() + Eigen::Vector3d(0.01, -0.02, 0.03);
        camera.rotation = Eigen::AngleAxisd(0.02, Eigen::Vector3d(1, 2, 3).normalized()) * camera.rotation;
        camera.translation = -(camera.rotation * center);
        camera.fx *= 1.01, camera.fy *= 1.01, camera.cx += 0.3, camera.cy -= 0.2;
    }
}

void expect_same_cameras(const Scene& expected, const Scene& found, const std::string& prefix) {
    ASSERT_EQ(found.train.size(), expected.train.size());
    ASSERT_EQ(found.test.size(), expected.test.size());
    for (std::size_t k = 0; k < expected.train.size(); ++k) {
        const Camera &a = expected.train[k].camera, &b = found.train[k].camera;
        EXPECT_EQ(found.train[k].name, prefix + expected.train[k].name);
        EXPECT_LT((a.rotation - b.rotation).norm(), 1e-9);
        EXPECT_LT((a.center() - b.center()).norm(), 1e-9);
        EXPECT_EQ(a.model, b.model);
        EXPECT_NEAR(a.fx, b.fx, 1e-9);
        EXPECT_NEAR(a.cx, b.cx, 1e-9);
        EXPECT_NEAR(a.cy, b.cy, 1e-9);
    }
    for (std::size_t k = 0; k < expected.test.size(); ++k)
        EXPECT_LT((expected.test[k].camera.center() - found.test[k].camera.center()).norm(), 1e-9);
}

TEST(RefinedScene, IsReadBackFromBothOfItsForms) {
    const TemporaryFolder folder;
    const std::vector<std::string> names = numbered(9);
    for (const TestCamera& camera : {TestCamera{}, TestCamera{1, 5, 16, 12, {12, 12, 8, 6, 0.01, 0.002, 0, 0}},
                                     TestCamera{1, 0, 16, 12, {20, 8, 6}}}) {
        SCOPED_TRACE(camera.model);
        const auto source = folder.path() / ("scene" + std::to_string(camera.model)), refined = source / "refined";
        write_colmap_scene(source, names);
        spit(source / "sparse/0/cameras.bin", cameras_bin({camera}));
        SceneOptions options = at(source, true);
        options.lens = LensMode::kNative;
        Scene scene = load_scene(options);
        move_cameras(scene);
        write_refined_scene(refined, scene);
        write_refined_scene(refined, scene);  // replaces what is there
        options.source = refined.string();
        const Scene model = load_scene(options, {.frame = scene.frame});
        expect_same_cameras(scene, model, "");
        EXPECT_EQ(model.points.positions, scene.points.positions);
        options.source = (refined / "transforms.json").string();
        options.test_every = 8;
        const Scene transforms = load_scene(options, {.frame = scene.frame});
        EXPECT_EQ(transforms.train.size() + transforms.test.size(), names.size());
    }
}

TEST(RefinedScene, StatesTheLensOfThePhotographIfItWasUndistorted) {
    const TemporaryFolder folder;
    const auto source = folder.path() / "scene";
    write_colmap_scene(source, numbered(5));
    spit(source / "sparse/0/cameras.bin", cameras_bin({{1, 2, 16, 12, {20, 8, 6, 0.05}}}));
    SceneOptions options = at(source);
    options.lens = LensMode::kUndistort;
    Scene scene = load_scene(options);
    move_cameras(scene);
    write_refined_scene(folder.path() / "refined", scene);
    options.source = (folder.path() / "refined").string();
    const Scene again = load_scene(options, {.frame = scene.frame});
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        EXPECT_NEAR(again.train[k].photograph.fx, 20 * 1.01, 1e-9);
        EXPECT_EQ(again.train[k].photograph.distortion[0], 0.05);
        EXPECT_EQ(again.train[k].photograph.model, CameraModel::kSimpleRadial);
        EXPECT_LT((scene.train[k].camera.center() - again.train[k].camera.center()).norm(), 1e-9);
    }
}

TEST(RefinedScene, IsNotWrittenWithoutPhotographs) {
    const TemporaryFolder folder;
    SceneOptions options = at("builtin:diffuse");
    options.resolution = 16;
    write_refined_scene(folder.path() / "refined", load_scene(options));
    EXPECT_FALSE(std::filesystem::exists(folder.path() / "refined"));
}

}  // namespace
}  // namespace gs::test
