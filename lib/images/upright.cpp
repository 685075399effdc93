// SPDX-License-Identifier: Apache-2.0
// Copies photographs with their metadata and upright pixels.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <exception>
#include <string>
#include <utility>

#include "kernels/base/error.h"
#include "lib/images/images.h"
#include "lib/io/orientation.h"

namespace gs::images {

std::vector<std::uint8_t> encode_upright(const std::filesystem::path& from, const std::filesystem::path& to,
                                         int orientation) try {
    const auto fail = [&](const std::string& reason) {
        throw DataError(fmt::format("image {}: cannot be turned upright: {}", from.string(), reason));
    };
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);  // else alpha would go through a multiplication and a division
    const auto input = OIIO::ImageInput::open(from.string(), &config);
    if (!input) fail(OIIO::geterror());
    OIIO::ImageSpec spec = input->spec();
    std::vector<char> pixels(spec.image_bytes(true));
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UNKNOWN, pixels.data())) fail(input->geterror());
    pixels = turned_pixels(pixels.data(), spec.width, spec.height, spec.pixel_bytes(true), orientation);
    if (is_quarter_turn(orientation)) std::swap(spec.width, spec.height);
    spec.full_width = spec.width, spec.full_height = spec.height;

    const std::string name = "image" + from.extension().string();  // only the extension counts
    const auto output = OIIO::ImageOutput::create(name);
    if (!output) fail(OIIO::geterror());
    spec.attribute("Orientation", 1);
    for (const char* stored_size : {"Exif:PixelXDimension", "Exif:PixelYDimension"}) spec.erase_attribute(stored_size);
    if (std::string(output->format_name()) == "jpeg") {
        spec.attribute("Compression", "jpeg:98");
        spec.attribute("jpeg:subsampling", "4:4:4");
    }
    // In memory, because OpenImageIO does not report that closing a file failed. Its TIFF writer loses EXIF there.
    const bool in_memory = std::string(output->format_name()) != "tiff";
    std::vector<std::uint8_t> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    if ((in_memory && !output->set_ioproxy(&memory)) || !output->open(in_memory ? name : to.string(), spec) ||
        !output->write_image(spec.format, pixels.data()) || !output->close())
        fail(output->geterror());
    return bytes;
} catch (const Error&) {
    throw;
} catch (const std::exception& e) {
    throw DataError(fmt::format("image {}: cannot be turned upright: {}", from.string(), e.what()));
}

}  // namespace gs::images
