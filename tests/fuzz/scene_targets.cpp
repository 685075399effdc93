// SPDX-License-Identifier: Apache-2.0
// Readers of datasets.
#include "lib/io/ply_file.h"
#include "lib/scene/colmap_reader.h"
#include "lib/scene/point_files.h"
#include "lib/scene/procedural_description.h"
#include "lib/scene/scene.h"
#include "lib/scene/source_scene.h"
#include "lib/scene/transforms_reader.h"
#include "tests/fuzz/target.h"
#include "tests/scene/scene_fixture.h"

namespace gs::fuzz {
namespace {

using test::TestCamera;

// A pinhole, a distorted and a fisheye camera, so that damaged parameters reach every kind of lens code.
std::string cameras_bin() {
    return test::cameras_bin({TestCamera{},
                              {2, 4, 16, 12, {20, 20, 8, 6, -0.1, 0.01, 0.001, 0.001}},
                              {3, 5, 16, 12, {20, 20, 8, 6, 0.01, 0, 0, 0}}});
}
std::string images_bin() {
    return test::images_bin({{1, {1, 0, 0, 0, 0, 0, 4}, 1, "a.png", 1},
                             {2, {1, 0, 0.1, 0, 0, 0, 4}, 2, "b.png", 2},
                             {3, {1, 0, 0, 0.1, 0, 1, 4}, 3, "c.png", 0}});
}
std::string points_bin() {
    return test::points_bin(
        {{1, 0, 0, 0, 255, 128, 0, 2}, {2, 0.5, 0.2, 0, 0, 0, 255, 1}, {7, -0.5, -0.2, 0.3, 9, 9, 9, 0}});
}
const std::string kCamerasTxt =
    "# cameras\n1 PINHOLE 16 12 20 20 8 6\n2 OPENCV 16 12 20 20 8 6 -0.1 0.01 0.001 0.001\n"
    "3 OPENCV_FISHEYE 16 12 20 20 8 6 0.01 0 0 0\n";
const std::string kImagesTxt =
    "# images\n1 1 0 0 0 0 0 4 1 a.png\n1 2 -1 3 4 5\n2 1 0 0.1 0 0 0 4 2 b.png\n\n3 1 0 0 0.1 0 1 4 3 c.png\n1 2 3\n";
const std::string kPointsTxt =
    "# points\n1 0 0 0 255 128 0 0.5 1 0 2 0\n2 0.5 0.2 0 0 0 255 0.1\n7 -0.5 -0.2 0.3 9 9 9 1e-3 1 1\n";

/// Writes a model's other files once, the fuzzed one each time, and reads all.
void read_model(const std::string& form, const std::string& name, const std::string& bytes) {
    const std::string place = "colmap_" + form + "_" + name;
    if (!std::filesystem::exists(folder() / place)) {
        put(place + "/cameras." + form, form == "bin" ? cameras_bin() : kCamerasTxt);
        put(place + "/images." + form, form == "bin" ? images_bin() : kImagesTxt);
        put(place + "/points3D." + form, form == "bin" ? points_bin() : kPointsTxt);
    }
    put(place + "/" + name + "." + form, bytes);
    read_colmap_model(folder() / place);
}

/// Lenses are resolved and scaled where an image is found, so the target does as much.
void read_frames(const std::string& bytes) {
    const TransformsFile file = read_transforms(put("transforms.json", bytes));
    for (const TransformsFrame& frame : file.frames) resolve_intrinsics(frame.intrinsics, 16, 12, frame.file_path);
}

void read_description(const std::string& bytes) {
    const procedural::Description description = procedural::parse_description(bytes, "scene.yaml");
    procedural::rig_camera(description.cameras, false, 0);
    procedural::train_world(description, 0);
    procedural::photography(description, false, 0);
}

void read_names(const std::string& bytes) {
    static const std::filesystem::path scene = [] {
        test::write_colmap_scene(folder() / "listed", {"a.png", "left/b.png", "c d.png"});
        return folder() / "listed";
    }();
    SceneOptions options;
    options.source = scene.string();
    options.eval = true;
    options.test_list = put("list.txt", bytes).string();
    load_scene(options);
}

std::string point_ply() {
    return written("points.ply", [](const std::filesystem::path& path) {
        std::ofstream out(path, std::ios::binary);
        PlyHeader header{{}, 2, {}, 0};
        for (const char* name : {"x", "y", "z"}) header.properties.push_back({name, PlyType::kFloat});
        for (const char* name : {"red", "green", "blue"}) header.properties.push_back({name, PlyType::kUint8});
        write_ply_header(out, header);
        const test::Bytes rows = test::Bytes{}.put(1.f).put(2.f).put(3.f).text("\x10\x20").put(4.f).put(5.f).put(6.f);
        out << rows.data() << "\x01\x02\x03";
    });
}

// Everything that a PLY may hold around its vertices.
const std::string kPointsText =
    "ply\nformat ascii 1.0\ncomment x\nelement camera 1\nproperty float focal\nproperty list uchar short pixels\n"
    "element vertex 2\nproperty double x\nproperty float y\nproperty list uchar int tracks\nproperty short z\n"
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n1.5 2 7 8\n1 2 0 3 0.1 0.2 0.3\n-1e3 nan 1 7 4 1 1 1\n3 0 1 "
    "1\n";

}  // namespace

std::vector<Target> scene_targets() {
    return {
        {"colmap_cameras.bin", [] { return std::vector{cameras_bin()}; },
         [](const std::string& bytes) { read_model("bin", "cameras", bytes); }},
        {"colmap_images.bin", [] { return std::vector{images_bin()}; },
         [](const std::string& bytes) { read_model("bin", "images", bytes); }},
        {"colmap_points3D.bin", [] { return std::vector{points_bin()}; },
         [](const std::string& bytes) { read_model("bin", "points3D", bytes); }},
        {"colmap_cameras.txt", [] { return std::vector{kCamerasTxt}; },
         [](const std::string& bytes) { read_model("txt", "cameras", bytes); }},
        {"colmap_images.txt", [] { return std::vector{kImagesTxt}; },
         [](const std::string& bytes) { read_model("txt", "images", bytes); }},
        {"colmap_points3D.txt", [] { return std::vector{kPointsTxt}; },
         [](const std::string& bytes) { read_model("txt", "points3D", bytes); }},
        {"transforms.json",
         [] {
             return std::vector<std::string>{
                 R"({"fl_x": 20.0, "fl_y": 21, "cx": 8, "cy": 6.5, "w": 16, "h": 12, "k1": -0.1, "k2": 0.01, "p1": 0.001,
"p2": 0, "camera_model": "OPENCV", "ply_file_path": "p.ply", "test_filenames": ["images/b"], "val_filenames": [], "train_filenames": ["a.png"],
"test_frames": [], "frames": [
{"file_path": "images/a.png", "transform_matrix": [[1,0,0,0.5],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
{"file_path": "images/b", "fl_x": 19, "is_bad": false, "transform_matrix": [[0,-1,0,0],[1,0,0,1.5],[0,0,1,4]]},
{"file_path": "./c.png", "mask_path": "m.png", "camera_angle_x": 0.8,
 "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]}]})",
                 R"({"camera_angle_x": 0.69, "frames": [{"file_path": "./train/r_0", "rotation": 0.01,
"transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})"};
         },
         read_frames},
        {"scene.yaml",
         [] {
             std::vector<std::string> texts;
             for (const std::string& name : procedural::embedded_scene_names())
                 texts.emplace_back(procedural::embedded_scene(name));
             return texts;
         },
         read_description},
        {"test_list.txt", [] { return std::vector<std::string>{"# held out\na.png\n\nleft/b\r\nc d.png \n"}; },
         read_names},
        {"points.ply",
         [] {
             std::string swapped = point_ply();
             swapped.replace(swapped.find("little"), 6, "big");
             return std::vector{point_ply(), swapped, kPointsText};
         },
         [](const std::string& bytes) {
             std::vector<std::string> notes;
             read_point_ply(put("points.ply", bytes), notes);
         }},
    };
}

}  // namespace gs::fuzz
