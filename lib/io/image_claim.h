// SPDX-License-Identifier: Apache-2.0
// Reads the format and size that an image file declares, before its pixels are decoded, and checks whether they are
// plausible for the file's length.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace gs {

/// The format and the size that the first bytes of a file declare.
struct ImageClaim {
    const char* format = nullptr;        ///< name of OpenImageIO's reader
    std::int64_t width = 0, height = 0;  ///< pixels; 0 = not in the first bytes (TIFF, EXR)
    double least_bytes = 0;              ///< size of the smallest valid file with such an image
    double work_bytes = 0;               ///< memory of the decoder besides the decoded image
};

/// Reads the first bytes. Throws DataError naming the file if it is not a PNG, JPEG, TIFF, WebP, BMP or EXR, or if it
/// is truncated before its size.
ImageClaim read_image_claim(const std::filesystem::path& path);

/// Throws DataError naming file and size if `claim` needs a longer file, or if it needs more memory than a file of this
/// length may request. `decoded_bytes` is the memory of the decoded image.
void check_image_claim(const std::filesystem::path& path, const ImageClaim& claim, double decoded_bytes);

}  // namespace gs
