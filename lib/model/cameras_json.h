// SPDX-License-Identifier: Apache-2.0
// cameras.json: the list of camera poses that 3DGS viewers read beside a model, and from which a run restores its
// views.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Returns the text [{id, img_name, width, height, position, rotation, fy, fx, cx, cy, split}], test views first, then
/// training views. id is the index in the list, position is in scene units, rotation is world_from_camera by rows,
/// focal lengths and principal point are in pixels, split is "test" or "train". Cameras with a lens also have
/// "camera_model" and "distortion", as COLMAP names and orders them. If an offset is subtracted in the run's
/// PLY files (file_offset), it is also subtracted from positions, and each entry states it as "offset": [x, y, z]. A
/// view whose camera was learned also has the dataset's, as "given": {position, rotation, fy, fx, cx, cy}, and training
/// views how far it moved, as "correction", in pixels.
std::string cameras_json(const Scene& scene);

/// Returns the text `cameras` of such a list with the learned cameras of the scene. Their entries state the dataset's
/// camera as "given", and those of training views their "correction", of which `corrections` has one for each.
std::string with_refined_cameras(const std::string& cameras, const Scene& scene,
                                 const std::vector<double>& corrections);

/// Sets the lens that an entry of such a list states, if it does, without its range. Throws DataError or
/// nlohmann::json::exception.
void set_listed_lens(const nlohmann::json& entry, Camera& camera);

/// Writes cameras.json. Throws DataError.
void write_cameras_json(const std::filesystem::path& path, const Scene& scene);

/// One view of cameras.json.
struct ListedView {
    std::string name;
    bool is_test = false;
    Camera camera;                          ///< camera of the dataset, in scene units
    std::optional<Camera> refined = {};     ///< the same as learned, if it was
    std::optional<double> correction = {};  ///< how far the camera of a training view moved, pixels
};

/// Returns the training views with a correction, the largest correction first.
std::vector<ListedView> corrected_views(std::vector<ListedView> views);

/// Reads the views with which a run began. Returns none if the file is missing or has no splits, like the files of
/// older versions and of other programs. Throws DataError naming file and entry.
std::vector<ListedView> read_cameras_json(const std::filesystem::path& path);

}  // namespace gs
