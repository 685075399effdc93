// SPDX-License-Identifier: Apache-2.0
// The sizes that pictures may have, and cameras for pictures of another size.
#pragma once

#include <optional>
#include <string>

#include "lib/scene/scene.h"

namespace gs {

/// A few bytes must not ask for the whole memory, and pixel bounds are 16-bit numbers on a device.
inline constexpr int kMaxPicturePixels = 1 << 25, kMaxPictureSide = 1 << 15;

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

}  // namespace gs
