// SPDX-License-Identifier: Apache-2.0
// Reads and writes images through the image module, converts images to masks, and turns images and files upright.
#include "lib/io/image.h"

#include <fmt/format.h>

#include <cmath>
#include <new>
#include <utility>

#include "kernels/base/error.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image_module.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail_for_memory(const fs::path& path) {
    throw DeviceError(
        fmt::format("image {}: out of memory while it was read; fewer --threads need less", path.string()));
}

/// Reads and checks the file's claim before the image module is loaded for it.
ImageSource checked_source(const fs::path& path) {
    ImageSource source{path, read_image_claim(path), check_image_claim};
    // A decoded image has at least three bytes per pixel; the number of channels is known only after opening.
    const double width = double(source.claim.width), height = double(source.claim.height);
    if (width > 0) check_image_claim(path, source.claim, 3.0 * width * height);
    return source;
}

/// Returns whether alpha differs among the pixels.
bool alpha_varies(const Image& image) {
    if (image.channels != 4) return false;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            if (image.value(x, y, 3) != image.value(0, 0, 3)) return true;
    return false;
}

/// Returns the factor that scales a mask to full weight if its file holds 0 and 1, or 0 to 255 in 16 bits; otherwise 1.
float mask_scale(const Image& image, float largest) {
    const float unit = image.is_float() ? 1 / 65535.0f : 1 / 255.0f, rounding = 0.1f * unit;
    if (std::abs(largest - unit) < rounding) return 1 / unit;
    return image.is_float() && largest > unit && largest < 255 * unit + rounding ? 257.0f : 1.0f;
}

}  // namespace

ImageInfo read_image_info(const fs::path& path) try {
    const ImageSource source = checked_source(path);
    return image_module().read_info(source);
} catch (const std::bad_alloc&) {
    fail_for_memory(path);
}

Image read_image(const fs::path& path) try {
    const ImageSource source = checked_source(path);
    return image_module().read(source);
} catch (const std::bad_alloc&) {
    fail_for_memory(path);
}

Image read_mask(const fs::path& path) {
    const Image in = read_image(path);
    const bool by_alpha = alpha_varies(in);
    const auto weight = [&](int x, int y) {
        // Rec. 709 luma. For the usual grey masks any weights with sum 1 give the same.
        return by_alpha ? in.value(x, y, 3)
                        : 0.2126f * in.value(x, y, 0) + 0.7152f * in.value(x, y, 1) + 0.0722f * in.value(x, y, 2);
    };
    float largest = 0;
    for (int y = 0; y < in.height; ++y)
        for (int x = 0; x < in.width; ++x) largest = std::max(largest, weight(x, y));
    const float scale = mask_scale(in, largest);
    Image mask;
    mask.width = in.width;
    mask.height = in.height;
    mask.channels = 1;
    mask.u8.resize(std::size_t(in.width) * in.height);
    for (int y = 0; y < in.height; ++y)
        for (int x = 0; x < in.width; ++x) mask.u8[std::size_t(y) * in.width + x] = to_8_bits(scale * weight(x, y));
    return mask;
}

void write_image(const fs::path& path, const Image& image) {
    const std::size_t samples = std::size_t(image.width) * image.height * image.channels;
    if (samples == 0 || (image.is_float() ? image.f32.size() : image.u8.size()) != samples)
        throw DataError(fmt::format("image {}: cannot write {}x{} with {} channels from {} bytes", path.string(),
                                    image.width, image.height, image.channels, image.bytes()));
    const std::vector<std::uint8_t> bytes = image_module().encode(path, image);
    write_text_atomic(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

std::vector<std::uint8_t> encode_jpeg(const Image& image, int quality) {
    return image_module().encode_jpeg(image, quality);
}

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
    read_image(from);  // throws if pixels are missing, which OpenImageIO returns as grey rows
    const std::vector<std::uint8_t> bytes = image_module().encode_upright(from, to, read_image_info(from).orientation);
    if (!bytes.empty())
        write_text_atomic(to, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    else
        read_image(to);  // throws if it is truncated
}

}  // namespace gs
