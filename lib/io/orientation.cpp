// SPDX-License-Identifier: Apache-2.0
// Turns pixels with OpenImageIO.
#include "lib/io/orientation.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imagebuf.h>
#include <OpenImageIO/imagebufalgo.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include "kernels/core/error.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

template <class T> void turn(std::vector<T>& values, OIIO::TypeDesc type, Image& image, int orientation) {
    OIIO::ImageSpec spec(image.width, image.height, image.channels, type);
    spec.attribute("Orientation", orientation);
    const OIIO::ImageBuf stored(spec, values.data());
    const OIIO::ImageBuf turned = OIIO::ImageBufAlgo::reorient(stored);
    std::vector<T> out(values.size());
    if (!turned.get_pixels(turned.roi(), type, out.data()))
        throw DataError(
            fmt::format("an image of {}x{} pixels cannot be turned: {}", image.width, image.height, turned.geterror()));
    image.width = turned.spec().width;
    image.height = turned.spec().height;
    values = std::move(out);
}

}  // namespace

Image upright(Image image, int orientation) {
    if (orientation == 1) return image;
    if (image.is_float())
        turn(image.f32, OIIO::TypeDesc::FLOAT, image, orientation);
    else
        turn(image.u8, OIIO::TypeDesc::UINT8, image, orientation);
    return image;
}

void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to) {
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
    const OIIO::ImageBuf turned = OIIO::ImageBufAlgo::reorient(OIIO::ImageBuf(spec, pixels.data()));
    if (turned.has_error()) fail(turned.geterror());

    const std::string name = "image" + from.extension().string();  // only the extension counts
    const auto output = OIIO::ImageOutput::create(name);
    if (!output) fail(OIIO::geterror());
    spec = turned.spec();
    spec.attribute("Orientation", 1);
    for (const char* stored_size : {"Exif:PixelXDimension", "Exif:PixelYDimension"}) spec.erase_attribute(stored_size);
    if (std::string(output->format_name()) == "jpeg") {
        spec.attribute("Compression", "jpeg:98");
        spec.attribute("jpeg:subsampling", "4:4:4");
    }
    pixels.resize(spec.image_bytes(true));
    turned.get_pixels(turned.roi(), spec.format, pixels.data());
    std::vector<unsigned char> bytes;
    OIIO::Filesystem::IOVecOutput memory(bytes);
    // In memory, because OpenImageIO does not report that closing a file failed.
    if (!output->set_ioproxy(&memory) || !output->open(name, spec) ||
        !output->write_image(spec.format, pixels.data()) || !output->close())
        fail(output->geterror());
    write_text_atomic(to, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace gs
