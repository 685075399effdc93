// SPDX-License-Identifier: Apache-2.0
// cameras.json: the list of poses that 3DGS viewers read beside a model, and by which a run knows its scene again.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Returns the text [{id, img_name, width, height, position, rotation, fy, fx, cx, cy, split}], test views first, then
/// training views. id is the index in the list, position is in scene units, rotation is world_from_camera by rows,
/// focal lengths and principal point are in pixels, split is "test" or "train". Where the run's PLY files lack an
/// offset (file_offset), positions lack it, too, and each entry states it as "offset": [x, y, z].
std::string cameras_json(const Scene& scene);

/// Writes cameras.json. Throws DataError.
void write_cameras_json(const std::filesystem::path& path, const Scene& scene);

/// A view in cameras.json.
struct ListedView {
    std::string name;
    bool is_test = false;
    Camera camera;  ///< scene units
};

/// Reads the views that a run was begun with. Returns none if the file is missing or does not state splits, as those of
/// older versions and of other programs. Throws DataError naming file and entry.
std::vector<ListedView> read_cameras_json(const std::filesystem::path& path);

}  // namespace gs
