// SPDX-License-Identifier: Apache-2.0
// Reads exposure settings from image files and converts them to stops.
#include "lib/scene/exif.h"

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"

namespace gs {

ExifSettings read_exif_settings(const std::filesystem::path& path) {
    try {
        return read_image_info(path).exposure;
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
