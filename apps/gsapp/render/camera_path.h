// SPDX-License-Identifier: Apache-2.0
// Reads cameras without photographs from a file, and fits cameras to pictures of another size.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// A few bytes must not ask for the whole memory, and pixel bounds are 16-bit numbers on a device.
inline constexpr int kMaxPicturePixels = 1 << 25, kMaxPictureSide = 1 << 15;

/// A size that a picture may have.
struct PictureSize {
    int width = 0, height = 0;
};

/// Returns the size in whole pixels; nothing for numbers that are none, are below 1, or are beyond the limits above.
std::optional<PictureSize> picture_size(double width, double height);

/// Says what picture_size() takes, in words.
std::string picture_size_limits();

/// Reads "WIDTHxHEIGHT". Throws UsageError for any other text, and for sizes that picture_size() does not take.
PictureSize parse_picture_size(const std::string& text);

/// Returns the camera of a picture of another size with the same vertical field of view. A wider picture shows more to
/// the left and to the right; the principal point keeps its place relative to the middle.
Camera with_vertical_field(Camera camera, const PictureSize& size);

/// Cameras in the order of a video.
struct CameraPath {
    std::vector<Camera> cameras;
    std::optional<double> fps;  ///< frames a second, if the file says so
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
