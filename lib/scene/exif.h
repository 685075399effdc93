// SPDX-License-Identifier: Apache-2.0
// Reads the exposure of photographs from their files' metadata.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Reads the exposure settings from the file's header only. All are empty if the file cannot be opened or has no
/// metadata.
ExifSettings read_exif_settings(const std::filesystem::path& path);

/// Returns log2(seconds * ISO/100 / f-number^2) of each image, in stops: one stop more is twice the light. A setting
/// that no image has is assumed equal for all images and left out. An image gets no value if it lacks a setting that
/// others have.
std::vector<std::optional<double>> exposure_stops(const std::vector<ExifSettings>& images);

}  // namespace gs
