// SPDX-License-Identifier: Apache-2.0
// Encodes images in memory, and copies photographs with their metadata and upright pixels.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <string>
#include <type_traits>
#include <utility>

#include "kernels/base/error.h"
#include "lib/images/image_file.h"
#include "lib/io/image.h"

namespace gs::images {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, const std::string& reason) {
    throw DataError(fmt::format("image {}: {}", path.string(), reason));
}

bool stores_float(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    return extension == ".exr" || extension == ".hdr" || extension == ".tif" || extension == ".tiff";
}

/// Writes the rows of an image to an open file in strips, which are converted one at a time so that no second image is
/// in memory. Float formats store floats; EXR stores premultiplied colour by definition (`premultiply`). Other formats
/// store 8 bits. Returns false if the encoder failed.
template <class Sample> bool write_rows(OIIO::ImageOutput& output, const Image& image, bool premultiply) {
    constexpr int kRows = 256;  // a multiple of the rows that EXR and TIFF compress together
    constexpr auto kType = std::is_same_v<Sample, float> ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT8;
    const std::size_t row = std::size_t(image.width) * image.channels;
    std::vector<Sample> strip;
    for (int y = 0; y < image.height; y += kRows) {
        const int end = std::min(y + kRows, image.height);
        const std::size_t first = y * row;
        strip.resize((end - y) * row);
        for (std::size_t i = 0; i < strip.size(); ++i) {
            if constexpr (std::is_same_v<Sample, float>)
                strip[i] = image.is_float() ? image.f32[first + i] : image.u8[first + i] * (1.0f / 255.0f);
            else
                strip[i] = image.is_float() ? to_8_bits(image.f32[first + i]) : image.u8[first + i];
        }
        if (premultiply && image.channels == 4)
            for (std::size_t i = 0; i < strip.size(); i += 4)
                for (int c = 0; c < 3; ++c) strip[i + c] *= strip[i + 3];
        if (!output.write_scanlines(y, end, 0, kType, strip.data())) return false;
    }
    return true;
}

/// Returns whether OpenImageIO correctly encodes the format in memory. The list is explicit, because OpenImageIO also
/// claims support for JPEG 2000, whose files then cannot be read.
bool is_encoded_in_memory(const std::string& format) {
    for (const char* name : {"png", "jpeg", "tiff", "openexr", "webp", "bmp"})
        if (format == name) return true;
    return false;
}

}  // namespace

// Encodes in memory, because OpenImageIO does not report a failure to close a file, and a full disk is only detected on
// closing.
std::vector<std::uint8_t> encode(const fs::path& path, const Image& image) {
    // Only the extension of the name is passed on, because OpenImageIO parses arguments from names with a question
    // mark.
    const std::string name = "image" + path.extension().string();
    const auto output = OIIO::ImageOutput::create(name);
    if (!output) fail(path, fmt::format("cannot be written: {}", reason_from(OIIO::geterror())));
    const std::string format = output->format_name();
    if (!is_encoded_in_memory(format)) fail(path, fmt::format("the format '{}' cannot be written; use PNG", format));
    // OpenImageIO's WebP writer always un-premultiplies in linear light, which changes straight colours.
    if (format == "webp" && image.channels == 4) fail(path, "WebP cannot be written with alpha; use PNG");
    const bool as_float = stores_float(path) && image.is_float();
    const bool is_exr = format == "openexr";
    const auto type = as_float || is_exr ? OIIO::TypeDesc::FLOAT : OIIO::TypeDesc::UINT8;
    OIIO::ImageSpec spec(image.width, image.height, image.channels, type);
    spec.attribute("oiio:UnassociatedAlpha", is_exr ? 0 : 1);
    if (format == "jpeg") spec.attribute("Compression", "jpeg:95");  // visually lossless previews

    std::vector<std::uint8_t> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    bool ok = output->set_ioproxy(&memory) && output->open(name, spec);
    if (ok) {
        ok = type == OIIO::TypeDesc::FLOAT ? write_rows<float>(*output, image, is_exr)
                                           : write_rows<std::uint8_t>(*output, image, false);
        ok = output->close() && ok;
    }
    if (!ok) fail(path, fmt::format("cannot be written: {}", reason_from(output->geterror())));
    return bytes;
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
    if (image.is_float() || image.channels != 3)
        throw UsageError("only 8-bit rgb images can be encoded as JPEG in memory");
    std::vector<std::uint8_t> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    const auto output = OIIO::ImageOutput::create("picture.jpg");
    OIIO::ImageSpec spec(image.width, image.height, 3, OIIO::TypeDesc::UINT8);
    spec.attribute("Compression", fmt::format("jpeg:{}", quality));
    const bool ok = output && output->set_ioproxy(&memory) && output->open("picture.jpg", spec) &&
                    output->write_image(OIIO::TypeDesc::UINT8, image.u8.data()) && output->close();
    if (!ok)
        throw DataError(fmt::format("a JPEG of {}x{} pixels cannot be encoded: {}", image.width, image.height,
                                    output ? output->geterror() : OIIO::geterror()));
    return bytes;
}

std::vector<std::uint8_t> encode_upright(const std::filesystem::path& from, const std::filesystem::path& to,
                                         int orientation) try {
    const auto fail = [&](const std::string& reason) {
        throw DataError(fmt::format("image {}: cannot be turned upright: {}", from.string(), reason));
    };
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);  // else colours would be multiplied and divided by alpha
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
    // Encodes in memory, because OpenImageIO does not report a failure to close a file. TIFF is the exception: its
    // writer loses EXIF in memory.
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
