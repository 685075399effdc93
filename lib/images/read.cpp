// SPDX-License-Identifier: Apache-2.0
// Reads image files: their headers, and their pixels as rgb or rgba.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <string>
#include <type_traits>

#include "lib/images/image_file.h"

namespace gs::images {
namespace {

/// The decoded channels used for rgb and alpha (-1 = none).
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

/// Returns the stored EXIF orientation; 1 for values that EXIF does not define.
int stored_orientation(const OIIO::ImageSpec& spec) {
    const int orientation = spec.get_int_attribute("Orientation", 1);
    return orientation >= 1 && orientation <= 8 ? orientation : 1;
}

/// Returns the first of these attributes with a positive value in the file.
std::optional<double> positive(const OIIO::ImageSpec& spec, std::initializer_list<const char*> names) {
    for (const char* name : names) {
        const double value = spec.get_float_attribute(name, 0);
        if (value > 0 && std::isfinite(value)) return value;
    }
    return {};
}

/// Appends decoded pixels to `out` with the planned channels, and undoes premultiplication if the file is
/// premultiplied. `one` is the value of full alpha.
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

}  // namespace

ImageInfo read_info(const ImageSource& source) {
    const ImageFile file(source);
    const OIIO::ImageSpec& spec = file.spec();
    return {spec.width,
            spec.height,
            plan_channels(spec).alpha >= 0 ? 4 : 3,
            decodes_to_float(spec),
            stored_orientation(spec),
            {positive(spec, {"ExposureTime"}), positive(spec, {"Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings"}),
             positive(spec, {"FNumber"})}};
}

Image read(const ImageSource& source) {
    ImageFile file(source);
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
            file.fail(fmt::format("pixel ({}, {}) is {}; every value must be finite", pixel % image.width,
                                  pixel / image.width, image.f32[i]));
        }
    } else {
        image.u8 = decoded<std::uint8_t>(file, plan, 255.0f);
    }
    return image;
}

}  // namespace gs::images
