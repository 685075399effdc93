// SPDX-License-Identifier: Apache-2.0
// cameras.json, the list of poses that 3DGS viewers read beside a model.
#pragma once

#include <filesystem>

#include "lib/scene/scene.h"

namespace gs {

/// Writes [{id, img_name, width, height, position, rotation, fy, fx}]: test views first, then training views, id = index
/// in the list; position in world units, rotation = world_from_camera by rows, focal lengths in pixels.
void write_cameras_json(const std::filesystem::path& path, const Scene& scene);

}  // namespace gs
