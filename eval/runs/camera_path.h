// SPDX-License-Identifier: Apache-2.0
// Makes cameras without photographs: from a file, or on a circle around the scene.
#pragma once

#include <filesystem>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Reads a list in the cameras.json format: width, height, position, rotation (3x3, world_from_camera by rows), fy, and
/// fx (fy when absent), and an "offset" that is added to the position. The principal point is the middle of the image.
/// Positions are in scene units; the cameras returned are in the frame. Throws DataError naming file, entry and field.
std::vector<Camera> read_camera_path(const std::filesystem::path& path, const Frame& frame);

/// Returns `count` cameras on a circle around the point that the cameras of `views` look at, at their mean distance and
/// height and with the first view's intrinsics. "Up" is the cameras' mean upward direction. Throws UsageError without
/// views and for count < 1.
std::vector<Camera> orbit_path(const std::vector<View>& views, int count);

}  // namespace gs
