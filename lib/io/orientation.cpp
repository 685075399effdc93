// SPDX-License-Identifier: Apache-2.0
// Turns images in memory, and files with the module for images.
#include "lib/io/orientation.h"

#include <utility>

#include "lib/io/atomic_file.h"
#include "lib/io/image_module.h"

namespace gs {

Image upright(Image image, int orientation) {
    if (orientation == 1) return image;
    void* const pixels = image.is_float() ? static_cast<void*>(image.f32.data()) : image.u8.data();
    const std::size_t sample = image.is_float() ? sizeof(float) : 1;
    const std::vector<char> out =
        turned_pixels(pixels, image.width, image.height, image.channels * sample, orientation);
    std::memcpy(pixels, out.data(), out.size());
    if (is_quarter_turn(orientation)) std::swap(image.width, image.height);
    return image;
}

void write_upright_copy(const std::filesystem::path& from, const std::filesystem::path& to) {
    read_image(from);  // throws where pixels are missing, which OpenImageIO hands out as grey rows
    const std::vector<std::uint8_t> bytes = image_module().encode_upright(from, to, read_image_info(from).orientation);
    if (!bytes.empty())
        write_text_atomic(to, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    else
        read_image(to);  // throws where it was cut off
}

}  // namespace gs
