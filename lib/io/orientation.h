// SPDX-License-Identifier: Apache-2.0
// Turns photographs upright. Cameras store pixels as the sensor lies, and how to turn them as a tag.
#pragma once

#include <filesystem>

#include "lib/io/image.h"

namespace gs {

/// Returns true for the EXIF orientations that exchange width and height.
constexpr bool is_quarter_turn(int orientation) { return orientation >= 5; }

/// Turns (and mirrors) the pixels as the EXIF orientation 1..8 says.
Image upright(Image image, int orientation);

/// Writes a copy whose pixels are upright, in the same format, with orientation 1 and all other metadata. JPEG is
/// encoded again at quality 98 without subsampling of colour. Throws DataError.
void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace gs
