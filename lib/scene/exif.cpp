// SPDX-License-Identifier: Apache-2.0
// Reads exposure settings from image files and turns them into stops.
#include "lib/scene/exif.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "kernels/base/error.h"
#include "lib/io/image_file.h"

namespace gs {
namespace {

std::optional<double> positive(const OIIO::ImageSpec& spec, std::initializer_list<const char*> names) {
    for (const char* name : names) {
        const double value = spec.get_float_attribute(name, 0);
        if (value > 0 && std::isfinite(value)) return value;
    }
    return {};
}

}  // namespace

ExifSettings read_exif_settings(const std::filesystem::path& path) {
    try {
        const ImageFile file(path);
        const OIIO::ImageSpec& spec = file.spec();
        return {positive(spec, {"ExposureTime"}),
                positive(spec, {"Exif:PhotographicSensitivity", "Exif:ISOSpeedRatings"}), positive(spec, {"FNumber"})};
    } catch (const DataError&) {
        return {};
    }
}

std::vector<std::optional<double>> exposure_stops(const std::vector<ExifSettings>& images) {
    const auto any = [&](auto member) {
        return std::any_of(images.begin(), images.end(),
                           [&](const ExifSettings& s) { return (s.*member).has_value(); });
    };
    const bool iso = any(&ExifSettings::iso), f_number = any(&ExifSettings::f_number);
    std::vector<std::optional<double>> stops;
    for (const ExifSettings& s : images) {
        const bool complete = s.seconds && (s.iso || !iso) && (s.f_number || !f_number);
        stops.emplace_back();
        if (complete)
            stops.back() = std::log2(*s.seconds * s.iso.value_or(100) / 100) - 2 * std::log2(s.f_number.value_or(1));
    }
    return stops;
}

}  // namespace gs
