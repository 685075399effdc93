// SPDX-License-Identifier: Apache-2.0
// Turns pixels, and reads and writes files with OpenImageIO.
#include "lib/io/orientation.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <cstring>
#include <exception>
#include <utility>

#include "kernels/base/error.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

/// Turns rows of pixels of `bytes` each. OpenImageIO 2.4 could do it but takes 5 for 7.
std::vector<char> turned(const void* stored, int width, int height, std::size_t bytes, int orientation) {
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

}  // namespace

Image upright(Image image, int orientation) {
    if (orientation == 1) return image;
    void* const pixels = image.is_float() ? static_cast<void*>(image.f32.data()) : image.u8.data();
    const std::size_t sample = image.is_float() ? sizeof(float) : 1;
    const std::vector<char> out = turned(pixels, image.width, image.height, image.channels * sample, orientation);
    std::memcpy(pixels, out.data(), out.size());
    if (is_quarter_turn(orientation)) std::swap(image.width, image.height);
    return image;
}

void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to) try {
    const auto fail = [&](const std::string& reason) {
        throw DataError(fmt::format("image {}: cannot be turned upright: {}", from.string(), reason));
    };
    read_image(from);  // throws where pixels are missing, which OpenImageIO hands out as grey rows
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);  // else alpha would go through a multiplication and a division
    const auto input = OIIO::ImageInput::open(from.string(), &config);
    if (!input) fail(OIIO::geterror());
    OIIO::ImageSpec spec = input->spec();
    std::vector<char> pixels(spec.image_bytes(true));
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UNKNOWN, pixels.data())) fail(input->geterror());
    const int orientation = read_image_info(from).orientation;
    pixels = turned(pixels.data(), spec.width, spec.height, spec.pixel_bytes(true), orientation);
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
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    if ((in_memory && !output->set_ioproxy(&memory)) || !output->open(in_memory ? name : to.string(), spec) ||
        !output->write_image(spec.format, pixels.data()) || !output->close())
        fail(output->geterror());
    if (in_memory)
        write_text_atomic(to, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    else
        read_image(to);  // throws where it was cut off
} catch (const Error&) {
    throw;
} catch (const std::exception& e) {
    throw DataError(fmt::format("image {}: cannot be turned upright: {}", from.string(), e.what()));
}

}  // namespace gs
