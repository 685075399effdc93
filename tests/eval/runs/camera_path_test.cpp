// SPDX-License-Identifier: Apache-2.0
// Camera paths: a round trip through cameras.json, the same cameras as nerfstudio writes them, and mistakes in such
// files.
#include "apps/gsapp/render/camera_path.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <Eigen/Dense>
#include <Eigen/LU>
#include <tuple>

#include "apps/gsapp/render/orbit.h"
#include "kernels/base/error.h"
#include "lib/model/cameras_json.h"
#include "tests/core/temporary_folder.h"
#include "tests/eval/runs/ring.h"

namespace gs {
namespace {

using Eigen::Vector3d;

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

// Orbits: what the training cameras decide, and what the user does.

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
