// SPDX-License-Identifier: Apache-2.0
// Turns photographs upright. Cameras store pixels as the sensor lies, and how to turn them as a tag.
#pragma once

#include <cstring>
#include <filesystem>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Returns true for the EXIF orientations that exchange width and height.
constexpr bool is_quarter_turn(int orientation) { return orientation >= 5; }

/// Turns (and mirrors) rows of pixels of `bytes` each as the EXIF orientation 1..8 says. OpenImageIO 2.4 could do it
/// but takes 5 for 7. Inline, because the module for images does the same (lib/images).
inline std::vector<char> turned_pixels(const void* stored, int width, int height, std::size_t bytes, int orientation) {
    const bool quarter = is_quarter_turn(orientation);
    const int out_width = quarter ? height : width, out_height = quarter ? width : height;
    // Which way the stored columns and rows run, seen from the upright image.
    const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
    const bool from_bottom = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
    std::vector<char> out(std::size_t(width) * height * bytes);
    for (int y = 0; y < out_height; ++y) {
        for (int x = 0; x < out_width; ++x) {
            const int column = quarter ? y : x, row = quarter ? x : y;
            const std::size_t from =
                std::size_t(from_bottom ? height - 1 - row : row) * width + (from_right ? width - 1 - column : column);
            std::memcpy(&out[(std::size_t(y) * out_width + x) * bytes], static_cast<const char*>(stored) + from * bytes,
                        bytes);
        }
    }
    return out;
}

/// Turns (and mirrors) the pixels as the EXIF orientation 1..8 says.
Image upright(Image image, int orientation);

/// Writes a copy whose pixels are upright, in the same format, with orientation 1 and all other metadata. JPEG is
/// encoded again at quality 98 without subsampling of colour. Throws DataError.
void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to);

}  // namespace gs
