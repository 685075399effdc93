// SPDX-License-Identifier: Apache-2.0
// Encodes JPEG files in memory.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include "kernels/base/error.h"
#include "lib/io/image.h"

namespace gs {

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

}  // namespace gs
