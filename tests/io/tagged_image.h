// SPDX-License-Identifier: Apache-2.0
// Photographs with an EXIF orientation.
#pragma once

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <vector>

namespace gs::test {

/// Writes an image whose stored pixels are white in the left half and black in the right one, taken in 1/100 s.
inline void write_tagged(const std::filesystem::path& path, int width, int height, int orientation) {
    std::filesystem::create_directories(path.parent_path());
    OIIO::ImageSpec spec(width, height, 3, OIIO::TypeDesc::UINT8);
    if (orientation != 1) spec.attribute("Orientation", orientation);
    spec.attribute("ExposureTime", 0.01f);
    spec.attribute("Exif:FocalLength", 35.0f);
    std::vector<std::uint8_t> pixels;
    for (int i = 0; i < width * height * 3; ++i) pixels.push_back(i / 3 % width < width / 2 ? 255 : 0);
    const auto output = OIIO::ImageOutput::create(path.string());
    ASSERT_TRUE(output && output->open(path.string(), spec) &&
                output->write_image(OIIO::TypeDesc::UINT8, pixels.data()) && output->close());
}

}  // namespace gs::test
