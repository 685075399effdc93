// SPDX-License-Identifier: Apache-2.0
// Puts refined cameras back before the photographs as they are on disk.
#include "lib/model/refined_scene.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/colmap_writer.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Returns an absolute path without following links, so that names in a linked folder stay relative to it.
fs::path plain(const fs::path& path) { return fs::absolute(path).lexically_normal(); }

/// Returns the folder of the scene to which the names of its photographs are relative.
fs::path image_root(const Scene& scene) {
    const fs::path source = plain(scene.source), folder = folder_exists(source) ? source : source.parent_path();
    return scene.image_folder.empty() ? folder : folder / scene.image_folder;
}

/// Returns the lens of a view's photograph, changed as that of the view was: the photograph may be larger, and the view
/// undistorted.
LensCamera refined_lens(const View& view) {
    LensCamera lens = view.photograph;
    if (!view.given) return lens;
    const Camera &given = *view.given, &now = view.camera;
    const double across = double(lens.width) / given.width, down = double(lens.height) / given.height;
    lens.fx *= now.fx / given.fx, lens.fy *= now.fy / given.fy;
    lens.cx += across * (now.cx - given.cx), lens.cy += down * (now.cy - given.cy);
    lens.distortion[0] += now.distortion[0] - given.distortion[0];
    return lens;
}

/// Returns the entry of a lens in transforms.json; null if the file cannot state it.
nlohmann::ordered_json lens_json(const LensCamera& lens) {
    const auto& d = lens.distortion;
    nlohmann::ordered_json out = {{"w", lens.width}, {"h", lens.height}, {"fl_x", lens.fx},
                                  {"fl_y", lens.fy}, {"cx", lens.cx},    {"cy", lens.cy}};
    switch (lens.model) {
        case CameraModel::kSimplePinhole:
        case CameraModel::kPinhole:
            out["camera_model"] = "PINHOLE";
            return out;
        case CameraModel::kSimpleRadial:
        case CameraModel::kRadial:
            out.update({{"camera_model", "OPENCV"}, {"k1", d[0]}, {"k2", d[1]}});
            return out;
        case CameraModel::kOpenCV:
            out.update({{"camera_model", "OPENCV"}, {"k1", d[0]}, {"k2", d[1]}, {"p1", d[2]}, {"p2", d[3]}});
            return out;
        case CameraModel::kOpenCVFisheye:
            out.update({{"camera_model", "OPENCV_FISHEYE"}, {"k1", d[0]}, {"k2", d[1]}, {"k3", d[2]}, {"k4", d[3]}});
            return out;
        default:
            return nullptr;
    }
}

/// Returns world_from_camera in the axes of OpenGL: x right, y up, z backwards.
nlohmann::ordered_json matrix_json(const Camera& camera) {
    const Eigen::Matrix3d axes = camera.rotation.transpose() * Eigen::Vector3d(1, -1, -1).asDiagonal();
    const Eigen::Vector3d center = camera.center();
    nlohmann::ordered_json rows = nlohmann::ordered_json::array();
    for (int r = 0; r < 3; ++r) rows.push_back({axes(r, 0), axes(r, 1), axes(r, 2), center[r]});
    rows.push_back({0, 0, 0, 1});
    return rows;
}

}  // namespace

void write_refined_scene(const fs::path& folder, const Scene& scene) {
    const fs::path images = image_root(scene);
    std::vector<PosedImage> posed;
    nlohmann::ordered_json frames = nlohmann::ordered_json::array();
    std::string test_names;
    bool states_all = true;
    for (const auto* views : {&scene.train, &scene.test})
        for (const View& view : *views) {
            if (view.file.empty()) return;
            const Camera camera = out_of_frame(view.camera, scene.frame);
            const std::string name = plain(view.file).lexically_relative(images).generic_string();
            posed.push_back({name, refined_lens(view), camera.rotation, camera.translation});
            if (views == &scene.test) test_names += name + "\n";
            nlohmann::ordered_json frame = lens_json(posed.back().lens);
            states_all = states_all && !frame.is_null();
            if (!states_all) continue;
            frame["file_path"] = "images/" + name;
            frame["transform_matrix"] = matrix_json(camera);
            frames.push_back(std::move(frame));
        }
    SourcePoints points;
    for (const Eigen::Vector3f& point : scene.points.positions)
        points.positions.push_back(scene.frame.to_scene(point.cast<double>()));
    points.colors = scene.points.colors;
    const fs::path model = folder / "sparse" / "0";
    write_colmap_model(model, posed, points);
    if (!test_names.empty()) write_text_atomic(model / "test.txt", test_names);
    nlohmann::ordered_json transforms;
    transforms["frames"] = std::move(frames);
    if (states_all) write_text_atomic(folder / "transforms.json", json_text(transforms, 1) + "\n");
    std::error_code failed;
    fs::remove(folder / "images", failed);
    fs::create_directory_symlink(images, folder / "images", failed);
    if (failed)
        throw DataError((folder / "images").string() + ": cannot be linked to " + images.string() + ": " +
                        failed.message());
}

}  // namespace gs
