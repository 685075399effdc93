// SPDX-License-Identifier: Apache-2.0
// Reads and writes images.
#include "lib/io/image.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <memory>
#include <new>
#include <string>
#include <type_traits>

#include "kernels/base/error.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image_file.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// The decoded channels that become rgb and alpha (-1 = none).
struct ChannelPlan {
    int rgb[3] = {0, 1, 2};
    int alpha = -1;
};

ChannelPlan plan_channels(const OIIO::ImageSpec& spec) {
    ChannelPlan plan;
    if (spec.nchannels < 3) plan.rgb[1] = plan.rgb[2] = 0;  // grey, grey+alpha
    const int first_possible_alpha = spec.nchannels < 3 ? 1 : 3;
    if (spec.alpha_channel >= first_possible_alpha) plan.alpha = spec.alpha_channel;
    return plan;
}

bool decodes_to_float(const OIIO::ImageSpec& spec) {
    return spec.format.basetype != OIIO::TypeDesc::UINT8 && spec.format.basetype != OIIO::TypeDesc::INT8;
}

/// Returns 1 also for values that EXIF does not define.
int stored_orientation(const OIIO::ImageSpec& spec) {
    const int orientation = spec.get_int_attribute("Orientation", 1);
    return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

[[noreturn]] void fail(const fs::path& path, const std::string& reason) {
    throw DataError(fmt::format("image {}: {}", path.string(), reason));
}

[[noreturn]] void fail_for_memory(const fs::path& path) {
    throw DeviceError(
        fmt::format("image {}: out of memory while it was read; fewer --threads need less", path.string()));
}

/// Appends decoded pixels to `out` with the planned channels, and undoes premultiplication where the file has it. `one`
/// is the value of full alpha.
template <class T>
void append(const T* in, std::size_t count, const OIIO::ImageSpec& spec, const ChannelPlan& plan, float one,
            std::vector<T>& out) {
    const int channels = plan.alpha >= 0 ? 4 : 3;
    const bool premultiplied = plan.alpha >= 0 && spec.get_int_attribute("oiio:UnassociatedAlpha", 0) == 0;
    if (spec.nchannels == channels && !premultiplied) {
        out.insert(out.end(), in, in + count);
        return;
    }
    const std::size_t pixels = count / std::size_t(spec.nchannels), begin = out.size();
    out.resize(begin + pixels * std::size_t(channels));
    for (std::size_t p = 0; p < pixels; ++p) {
        const T* source = &in[p * spec.nchannels];
        T* target = &out[begin + p * channels];
        for (int c = 0; c < 3; ++c) target[c] = source[plan.rgb[c]];
        if (plan.alpha < 0) continue;
        const float alpha = target[3] = source[plan.alpha];
        if (!premultiplied || alpha <= 0) continue;
        for (int c = 0; c < 3; ++c) {
            const float straight = target[c] * one / alpha;
            if constexpr (std::is_same_v<T, std::uint8_t>)
                target[c] = static_cast<T>(std::min(straight + 0.5f, one));
            else
                target[c] = straight;
        }
    }
}

template <class T> std::vector<T> decoded(ImageFile& file, const ChannelPlan& plan, float one) {
    std::vector<T> out;
    out.reserve(std::size_t(file.spec().width) * file.spec().height * (plan.alpha >= 0 ? 4 : 3));
    file.decode<T>([&](const T* in, std::size_t count) { append(in, count, file.spec(), plan, one, out); });
    return out;
}

bool stores_float(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return std::tolower(c); });
    return extension == ".exr" || extension == ".hdr" || extension == ".tif" || extension == ".tiff";
}

/// Writes the rows of an image to an open file in strips, which are converted one at a time so that no second image is
/// held. Float formats keep floats, where EXR holds premultiplied colour by definition (`premultiply`); others hold 8
/// bits. Returns false if the encoder failed.
template <class Sample> bool write_rows(OIIO::ImageOutput& output, const Image& image, bool premultiply) {
    constexpr int kRows = 256;  // a multiple of what the compressions of EXR and TIFF take together
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

/// Whether OpenImageIO encodes the format into memory, faithfully. It says so of JPEG 2000, too, which then cannot be
/// read.
bool is_encoded_in_memory(const std::string& format) {
    for (const char* name : {"png", "jpeg", "tiff", "openexr", "webp", "bmp"})
        if (format == name) return true;
    return false;
}

/// Encodes in the format of the path's extension. In memory, because OpenImageIO does not report that closing a file
/// failed, and a full disk shows only then.
std::vector<unsigned char> encode(const fs::path& path, const Image& image) {
    // Only the extension of the name is passed on: OpenImageIO reads arguments out of names with a question mark.
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

    std::vector<unsigned char> bytes;
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

}  // namespace

ImageInfo read_image_info(const fs::path& path) try {
    const ImageFile file(path);
    const OIIO::ImageSpec& spec = file.spec();
    return {spec.width, spec.height, plan_channels(spec).alpha >= 0 ? 4 : 3, decodes_to_float(spec),
            stored_orientation(spec)};
} catch (const std::bad_alloc&) {
    fail_for_memory(path);
}

Image read_image(const fs::path& path) try {
    ImageFile file(path);
    const OIIO::ImageSpec& spec = file.spec();
    const ChannelPlan plan = plan_channels(spec);
    Image image;
    image.width = spec.width;
    image.height = spec.height;
    image.channels = plan.alpha >= 0 ? 4 : 3;
    if (decodes_to_float(spec)) {
        image.f32 = decoded<float>(file, plan, 1.0f);
        for (std::size_t i = 0; i < image.f32.size(); ++i) {
            if (std::isfinite(image.f32[i])) continue;
            const std::size_t pixel = i / image.channels;
            fail(path, fmt::format("pixel ({}, {}) is {}; every value must be finite", pixel % image.width,
                                   pixel / image.width, image.f32[i]));
        }
    } else {
        image.u8 = decoded<std::uint8_t>(file, plan, 255.0f);
    }
    return image;
} catch (const std::bad_alloc&) {
    fail_for_memory(path);
}

namespace {

/// Returns whether the alpha channel tells pixels apart.
bool alpha_varies(const Image& image) {
    if (image.channels != 4) return false;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            if (image.value(x, y, 3) != image.value(0, 0, 3)) return true;
    return false;
}

/// Returns the factor that makes the largest value of a mask full weight, if the file holds 0 and 1, or 0 to 255 in 16
/// bits.
float mask_scale(const Image& image, float largest) {
    const float unit = image.is_float() ? 1 / 65535.0f : 1 / 255.0f, rounding = 0.1f * unit;
    if (std::abs(largest - unit) < rounding) return 1 / unit;
    return image.is_float() && largest > unit && largest < 255 * unit + rounding ? 257.0f : 1.0f;
}

}  // namespace

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
        fail(path, fmt::format("cannot write {}x{} with {} channels from {} bytes", image.width, image.height,
                               image.channels, image.bytes()));
    const std::vector<unsigned char> bytes = encode(path, image);
    write_text_atomic(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

}  // namespace gs
