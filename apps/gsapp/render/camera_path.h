// SPDX-License-Identifier: Apache-2.0
// Reads cameras without photographs from a file, and adapts cameras to another image size.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Limits on the image size: small input must not request all of the memory, and pixel bounds on a device are 16-bit.
inline constexpr int kMaxPicturePixels = 1 << 25, kMaxPictureSide = 1 << 15;

/// A valid image size, px.
struct PictureSize {
    int width = 0, height = 0;
};

/// Returns the size in whole pixels; nothing for values that are not finite numbers, are below 1, or exceed the limits
/// above.
std::optional<PictureSize> picture_size(double width, double height);

/// Describes the sizes that picture_size() accepts.
std::string picture_size_limits();

/// Parses "WIDTHxHEIGHT". Throws UsageError for any other text, and for sizes that picture_size() rejects.
PictureSize parse_picture_size(const std::string& text);

/// Returns the camera for another image size with the same vertical field of view. A wider image shows more on the left
/// and right; the principal point keeps its offset relative to the centre.
Camera with_vertical_field(Camera camera, const PictureSize& size);

/// Cameras in the order of a video.
struct CameraPath {
    std::vector<Camera> cameras;
    std::optional<double> fps;  ///< frames per second, if given in the file
};

/// Range of valid frame rates for videos, in frames per second.
inline constexpr double kLeastFps = 0.01, kMostFps = 1000;

/// Reads a file in one of three formats, detected from its content; see docs/formats.md. Positions are in scene units;
/// the returned cameras are in `frame`. Throws DataError naming file, entry and field.
///  - a list as in cameras.json: width, height, position, rotation (3x3, world_from_camera, by rows), fy, optional fx
///    (default: fy), cx and cy (default: the image centre), and an optional "offset" added to the position.
///  - an object as in nerfstudio's camera_path.json: render_width, render_height, and a list camera_path of
///    camera_to_world (16 numbers by rows; y is up and the camera looks along -z) and fov (vertical, degrees).
///  - an object with "frames" as in transforms.json (lib/scene/transforms_reader.h), whose lens distortion is ignored.
///    Without w and h the size is that of its images.
CameraPath read_camera_path(const std::filesystem::path& path, const Frame& frame);

}  // namespace gs
