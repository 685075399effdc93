// SPDX-License-Identifier: Apache-2.0
// Writes cameras.json, the list of poses that 3DGS viewers read beside a model.
#pragma once

#include <filesystem>

#include "lib/scene/scene.h"

namespace gs {

/// Writes [{id, img_name, width, height, position, rotation, fy, fx}], test views first, then training views. id is the
/// index in the list, position is in scene units, rotation is world_from_camera by rows, focal lengths are in pixels.
/// Where the run's PLY files lack an offset (file_offset), positions lack it, too, and each entry states it as
/// "offset": [x, y, z].
void write_cameras_json(const std::filesystem::path& path, const Scene& scene);

}  // namespace gs
