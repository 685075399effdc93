// SPDX-License-Identifier: Apache-2.0
// How a photograph was exposed, as its file says.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

namespace gs {

/// What a file says; settings that are absent, zero, negative or not finite are empty.
struct ExifSettings {
    std::optional<double> seconds, iso, f_number;
};

/// Reads the header only. A file that cannot be opened, or is of a kind without metadata, says nothing.
ExifSettings read_exif_settings(const std::filesystem::path& path);

/// log2(seconds * ISO/100 / f-number^2) of each image, in stops: one more is twice the light. A setting that no image has is
/// taken as equal in all of them and left out; an image that lacks one which others have gets no value.
std::vector<std::optional<double>> exposure_stops(const std::vector<ExifSettings>& images);

}  // namespace gs
