// SPDX-License-Identifier: Apache-2.0
// Camera paths: a round trip through cameras.json, the same cameras as nerfstudio writes them, and mistakes in such
// files.
#include "apps/gsapp/render/camera_path.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <tuple>

#include "kernels/base/error.h"
#include "lib/model/cameras_json.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/runs/ring.h"

namespace gs {
namespace {

std::string replaced(std::string text, const std::string& from, const std::string& to) {
    const std::size_t at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return text.replace(at, from.size(), to);
}

/// Expects a message that names the file and has `part`.
void expect_refused(const std::filesystem::path& file, const std::string& part) {
    try {
        read_camera_path(file, {});
        ADD_FAILURE() << part;
    } catch (const DataError& e) {
        EXPECT_EQ(std::string(e.what()).rfind(file.string(), 0), 0u) << e.what();
        EXPECT_NE(std::string(e.what()).find(part), std::string::npos) << e.what() << " has no: " << part;
    }
}

TEST(CameraPath, ReadsWhatIsWrittenForViewers) {
    const test::TemporaryFolder folder;
    Scene scene;
    scene.train = ring();
    write_cameras_json(folder.path() / "cameras.json", scene);
    const auto cameras = read_camera_path(folder.path() / "cameras.json", {}).cameras;
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
    const auto cameras = read_camera_path(folder.path() / "cameras.json", scene.frame).cameras;
    const auto in_scene = read_camera_path(folder.path() / "cameras.json", {}).cameras;
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        const Eigen::Vector3d center = scene.train[i].camera.center();
        EXPECT_NEAR((cameras[i].center() - center).norm(), 0, 1e-9);
        EXPECT_NEAR((in_scene[i].center() - scene.frame.to_scene(center)).norm(), 0, 1e-6);
    }
    // A file without an offset has the scene's own coordinates.
    const auto own =
        read_camera_path(folder.write("own.json", R"([{"width":8,"height":6,"position":[500100,4000000,100],)"
                                                  R"("rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])"),
                         scene.frame)
            .cameras;
    EXPECT_NEAR((own[0].center() - Eigen::Vector3d(1, 0, 0)).norm(), 0, 1e-9);
}

TEST(CameraPath, MistakesAreNamed) {
    const test::TemporaryFolder folder;
    const std::string good = R"({"width":8,"height":6,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5})";
    EXPECT_EQ(read_camera_path(folder.write("good.json", "[" + good + "]"), {}).cameras[0].fx, 5);
    const std::pair<const char*, const char*> cases[] = {
        {"[]", "list of cameras is empty"},
        {"{", "list of cameras"},
        {"{}", "neither"},
        {"[7]", "entry 0: it is no JSON object"},
        {R"([{"width":8}])", "entry 0: 'height' is missing"},
        {R"([{"width":8,"height":6,"position":[0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "entry 0"},
        {R"([{"width":8,"height":6,"position":[0,0,0],"rotation":[[2,0,0],[0,1,0],[0,0,1]],"fy":5}])", "rotation"},
        {R"([{"width":-8,"height":6,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "width is -8"},
        {R"([{"width":"8","height":6}])", "number"},
        {R"([{"width":900000,"height":600,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],"fy":5}])", "900000"},
    };
    for (const auto& [text, expected] : cases) expect_refused(folder.write("bad.json", text), expected);
    // Changes of the good entry, each with what is said about it.
    const std::tuple<const char*, const char*, const char*> changes[] = {
        {R"("fy":5)", R"("fy":0)", "entry 0: fy is 0"},
        {R"("fy":5)", R"("fy":5,"fx":1e7)", "fx is 10000000"},
        {R"("fy":5)", R"("fy":NaN)", "bad.json: not a JSON"},
        {R"("fy":5)", R"("fy":1e999)", "bad.json: not a JSON"},
        {R"("fy":5)", R"("fy":null)", "'fy' is null, not a number"},
        {R"("width":8)", R"("width":8.5)", "width is 8.5"},
        {R"("width":8)", R"("width":0)", "width is 0"},
        {R"("width":8)", R"("width":32769)", "width is 32769"},
        {R"("width":8,"height":6)", R"("width":8192,"height":4097)", "at most 33554432"},
        {"[0,0,0],", R"([0,0,1e300],)", "'position' has 1e+300"},
        {"[0,0,1]]", "[0,0,-1]]", "'rotation' is no rotation"},
        {"[0,0,1]]", "[0,0,1],[0,0,1]]", "'rotation' is no list of 3 rows"},
        {R"("fy":5)", R"("fy":5,"offset":[1,2])", "'offset' is no list of 3 numbers"},
    };
    for (const auto& [from, to, expected] : changes)
        expect_refused(folder.write("bad.json", "[" + replaced(good, from, to) + "]"), expected);
    EXPECT_THROW(read_camera_path(folder.path() / "missing.json", {}), DataError);
    for (const char* size : {R"("width":1,"height":1)", R"("width":8192,"height":4096)"})
        EXPECT_EQ(
            read_camera_path(folder.write("good.json", "[" + replaced(good, R"("width":8,"height":6)", size) + "]"), {})
                .cameras.size(),
            1u);
}

TEST(CameraPath, OfNerfstudioHoldsTheSameCameras) {
    const test::TemporaryFolder folder;
    const std::vector<View> views = ring();
    const Frame frame{{1, 2, 3}, 0.5};
    std::string entries;
    for (const View& view : views) {
        // There y is up and z points back, and the file has scene coordinates.
        const Eigen::Matrix3d axes = view.camera.rotation.transpose() * Eigen::Vector3d(1, -1, -1).asDiagonal();
        const Eigen::Vector3d place = frame.to_scene(view.camera.center());
        entries += entries.empty() ? R"({"camera_to_world":[)" : R"(,{"camera_to_world":[)";
        for (int r = 0; r < 3; ++r)
            entries += fmt::format("{},{},{},{},", axes(r, 0), axes(r, 1), axes(r, 2), place[r]);
        entries += R"(0,0,0,1],"fov":60,"aspect":1.5})";
    }
    const CameraPath path = read_camera_path(
        folder.write("camera_path.json", R"({"camera_type":"perspective","render_width":90,"render_height":60,)"
                                         R"("fps":24,"camera_path":[)" +
                                             entries + "]}"),
        frame);
    ASSERT_EQ(path.cameras.size(), views.size());
    EXPECT_EQ(path.fps, 24);
    for (std::size_t i = 0; i < views.size(); ++i) {
        const Camera &a = path.cameras[i], &b = views[i].camera;
        EXPECT_NEAR((a.rotation - b.rotation).norm() + (a.translation - b.translation).norm(), 0, 1e-9);
        EXPECT_EQ(a.width, 90);
        EXPECT_EQ(a.cy, 30);
        EXPECT_NEAR(std::atan(30 / a.fy) * 360 / M_PI, 60, 1e-9) << "the vertical angle";
        EXPECT_EQ(a.fx, a.fy);
    }
}

TEST(CameraPath, OfNerfstudioNamesMistakes) {
    const test::TemporaryFolder folder;
    const std::string good =
        R"({"camera_type":"perspective","render_width":9,"render_height":6,"fps":24,"camera_path":[)"
        R"({"camera_to_world":[1,0,0,4,0,1,0,5,0,0,1,6,0,0,0,1],"fov":50,"aspect":1.5}]})";
    EXPECT_EQ(read_camera_path(folder.write("good.json", good), {}).cameras[0].center(), Eigen::Vector3d(4, 5, 6));
    const std::tuple<const char*, const char*, const char*> changes[] = {
        {R"("fov":50)", R"("fov":180)", "camera_path entry 0: fov is 180; it has to be above 0 and below 180"},
        {R"("fov":50)", R"("fov":0)", "fov is 0"},
        {R"("fov":50)", R"("fov":-50)", "fov is -50"},
        {R"("fov":50)", R"("fov":NaN)", "bad.json: not a JSON"},
        {R"("fov":50)", R"("fov":"50")", "'fov' is \"50\", not a number"},
        {R"("fov":50,)", "", "camera_path entry 0: 'fov' is missing"},
        {"[1,0,0,4", "[2,0,0,4", "'camera_to_world' is no rotation"},
        {"[1,0,0,4", "[-1,0,0,4", "'camera_to_world' is no rotation"},
        {"[1,0,0,4", "[1,0,0", "'camera_to_world' is no list of 16 numbers"},
        {"[1,0,0,4", "[1,0,null,4", "'camera_to_world' is null, not a number"},
        {"[1,0,0,4", "[1,0,0,1e300", "'camera_to_world' has 1e+300"},
        {"0,0,0,1]", "0,0,0,2]", "the last row of 'camera_to_world'"},
        {R"("render_width":9)", R"("render_width":1000000)", "render_width is 1000000"},
        {R"("render_width":9,)", "", "'render_width' is missing"},
        {R"("fps":24)", R"("fps":0)", "fps is 0"},
        {"perspective", "equirectangular", "'camera_type' is \"equirectangular\""},
    };
    for (const auto& [from, to, expected] : changes)
        expect_refused(folder.write("bad.json", replaced(good, from, to)), expected);
    expect_refused(folder.write("bad.json", R"({"render_width":9,"render_height":6,"camera_path":[]})"), "empty");
    expect_refused(folder.write("bad.json", R"({"render_width":9,"render_height":6,"camera_path":7})"), "no list");
    expect_refused(folder.write("bad.json", R"({"render_width":9,"render_height":6,"camera_path":[7]})"),
                   "no JSON obj");
}

}  // namespace
}  // namespace gs
