// SPDX-License-Identifier: Apache-2.0
// Camera paths: a round trip through cameras.json, mistakes in such files, and the orbit.
#include "eval/runs/camera_path.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "kernels/core/error.h"
#include "lib/model/cameras_json.h"
#include "lib/scene/procedural_description.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

std::vector<View> ring() {
    procedural::CameraRig rig;
    rig.look_at = {1, 2, 0.5};
    rig.elevation_min = rig.elevation_max = 30;
    std::vector<View> views(12);
    rig.train = 12;
    for (int i = 0; i < 12; ++i) views[i].camera = procedural::rig_camera(rig, false, i);
    return views;
}

TEST(CameraPath, ReadsWhatIsWrittenForViewers) {
    const test::TemporaryFolder folder;
    Scene scene;
    scene.train = ring();
    write_cameras_json(folder.path() / "cameras.json", scene);
    const auto cameras = read_camera_path(folder.path() / "cameras.json", {});
    ASSERT_EQ(cameras.size(), 12u);
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        const Camera &a = cameras[i], &b = scene.train[i].camera;
        EXPECT_NEAR((a.rotation - b.rotation).norm() + (a.translation - b.translation).norm(), 0, 1e-9);
        EXPECT_EQ(a.width, b.width);
        EXPECT_NEAR(a.fx, b.fx, 1e-9);
        EXPECT_NEAR(a.cx, b.cx, 1e-9);
    }
}

TEST(CameraPath, MapCoordinatesAreReadFromTheFilesOffset) {
    const test::TemporaryFolder folder;
    Scene scene;
    scene.frame = {{5e5, 4e6, 100}, 0.01};
    scene.train = ring();
    write_cameras_json(folder.path() / "cameras.json", scene);
    const auto cameras = read_camera_path(folder.path() / "cameras.json", scene.frame);
    const auto in_scene = read_camera_path(folder.path() / "cameras.json", {});
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        const Eigen::Vector3d center = scene.train[i].camera.center();
        EXPECT_NEAR((cameras[i].center() - center).norm(), 0, 1e-9);
        EXPECT_NEAR((in_scene[i].center() - scene.frame.to_scene(center)).norm(), 0, 1e-6);
    }
    // A file without an offset has the scene's own coordinates.
    const auto own =
        read_camera_path(folder.write("own.json", R"([{"width":8,"height":6,"position":[500100,4000000,100],)"
                                                  R"("rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])"),
                         scene.frame);
    EXPECT_NEAR((own[0].center() - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-9);
}

TEST(CameraPath, MistakesAreNamed) {
    const test::TemporaryFolder folder;
    const std::string good = R"({"width":8,"height":6,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5})";
    EXPECT_EQ(read_camera_path(folder.write("good.json", "[" + good + "]"), {})[0].fx, 5);
    const std::pair<const char*, const char*> cases[] = {
        {"[]", "list of cameras"},
        {"{", "list of cameras"},
        {R"([{"width":8}])", "height"},
        {R"([{"width":8,"height":6,"position":[0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "entry 0"},
        {R"([{"width":8,"height":6,"position":[0,0,0],"rotation":[[2,0,0],[0,1,0],[0,0,1]],"fy":5}])", "rotation"},
        {R"([{"width":-8,"height":6,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "width is -8"},
        {R"([{"width":"8","height":6}])", "number"},
        {R"([{"width":900000,"height":600,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "900000"},
    };
    for (const auto& [text, expected] : cases) {
        try {
            read_camera_path(folder.write("bad.json", text), {});
            ADD_FAILURE() << text;
        } catch (const DataError& e) {
            EXPECT_NE(std::string(e.what()).find(expected), std::string::npos) << e.what();
        }
    }
    EXPECT_THROW(read_camera_path(folder.path() / "missing.json", {}), DataError);
}

TEST(CameraPath, OrbitOfARingIsTheRing) {
    const auto views = ring();
    const Eigen::Vector3d target(1, 2, 0.5);
    for (const Camera& camera : orbit_path(views, 7)) {
        EXPECT_NEAR((camera.center() - target).norm(), 4, 0.2);
        const Eigen::Vector3d seen = camera.rotation * target + camera.translation;
        EXPECT_NEAR(seen.head<2>().norm(), 0, 0.05);
        EXPECT_NEAR(camera.rotation.determinant(), 1, 1e-9);
        EXPECT_LT((camera.rotation * Eigen::Vector3d(0, 0, 1)).y(), -0.5) << "world up points up in the picture";
        EXPECT_EQ(camera.width, views[0].camera.width);
    }
    EXPECT_THROW(orbit_path({}, 7), UsageError);
    EXPECT_THROW(orbit_path(views, 0), UsageError);
    EXPECT_TRUE(orbit_path({views[0]}, 3)[2].translation.allFinite());
}

}  // namespace
}  // namespace gs
