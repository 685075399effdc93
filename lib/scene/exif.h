// SPDX-License-Identifier: Apache-2.0
// The exposure of a photograph, from its file's metadata.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// Reads the settings from the header only. They are all empty for a file that cannot be opened or has no metadata.
ExifSettings read_exif_settings(const std::filesystem::path& path);

/// Returns log2(seconds * ISO/100 / f-number^2) of each image, in stops: one more is twice the light. A setting that no
/// image has is taken as equal in all of them and left out. An image that lacks a setting which others have gets no
/// value.
std::vector<std::optional<double>> exposure_stops(const std::vector<ExifSettings>& images);

}  // namespace gs
