// SPDX-License-Identifier: Apache-2.0
// What the module for images does for the program: the functions of lib/io/image_module.h.
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "lib/io/image_module.h"

namespace gs::images {

ImageInfo read_info(const ImageSource& source);
Image read(const ImageSource& source);
std::vector<std::uint8_t> encode(const std::filesystem::path& path, const Image& image);
std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality);
std::vector<std::uint8_t> encode_upright(const std::filesystem::path& from, const std::filesystem::path& to,
                                         int orientation);

}  // namespace gs::images
