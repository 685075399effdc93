// SPDX-License-Identifier: Apache-2.0
// Reads cameras without photographs from a file.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Cameras in the order of a video.
struct CameraPath {
    std::vector<Camera> cameras;
    std::optional<double> fps;  ///< frames a second, where the file says so
};

/// The rates that videos may have, in frames a second.
inline constexpr double kLeastFps = 0.01, kMostFps = 1000;

/// Reads a file in one of three forms, told apart by their content; docs/formats.md has them. Positions are in scene
/// units; the cameras returned are in the frame. Throws DataError naming file, entry and field.
///  - a list as in cameras.json: width, height, position, rotation (3x3, world_from_camera by rows), fy, and fx (fy
///    when absent), cx and cy (the middle of the image when absent), and an "offset" that is added to the position.
///  - an object as nerfstudio's camera_path.json: render_width, render_height, and a list camera_path of
///    camera_to_world (16 numbers by rows; y is up and the camera looks along -z) and fov (vertical, degrees).
///  - an object with "frames" as a transforms.json (lib/scene/transforms_reader.h), whose lenses' distortion is left
///    out. Without w and h its images say the size.
CameraPath read_camera_path(const std::filesystem::path& path, const Frame& frame);

}  // namespace gs
