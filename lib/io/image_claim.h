// SPDX-License-Identifier: Apache-2.0
// What an image file says of itself before its pixels are decoded, and whether a file of its length can hold that.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace gs {

/// The format and the size that the first bytes of a file declare.
struct ImageClaim {
    const char* format = nullptr;        ///< the name of OpenImageIO's reader
    std::int64_t width = 0, height = 0;  ///< pixels; 0 = these bytes do not tell (TIFF, EXR)
    double least_bytes = 0;              ///< no valid file of that size is shorter
    double work_bytes = 0;               ///< what the decoder needs beside the decoded image
};

/// Reads the first bytes. Throws DataError naming the file for one that is no PNG, JPEG, TIFF, WebP, BMP or EXR, or
/// that is truncated before its size.
ImageClaim read_image_claim(const std::filesystem::path& path);

/// Throws DataError naming file and size when `claim` needs a longer file, or when it needs more memory than a file of
/// this length may ask for. `decoded_bytes` is the memory of the decoded image.
void check_image_claim(const std::filesystem::path& path, const ImageClaim& claim, double decoded_bytes);

}  // namespace gs
