// SPDX-License-Identifier: Apache-2.0
// Makes films of pictures with the program ffmpeg.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Checks, before anything is rendered, that a film of these views can be made. Throws UsageError for a name that ends
/// neither in .mp4 nor in .webm, for pictures of different sizes or of fewer than 2x2 pixels, and where ffmpeg is not
/// installed.
void require_film(const std::filesystem::path& film, const std::vector<View>& views);

/// Makes a film of the pictures 00000.png, ..., of a folder: H.264 or VP9, by the ending of the name, with 8 bits and
/// colour at half the resolution, as every player shows it. Such films have even sizes, so an odd last row or column is
/// cut off. An earlier film of this name is replaced. Throws DataError with ffmpeg's last lines if it fails, and
/// Interrupted.
void make_film(const std::filesystem::path& film, const std::filesystem::path& pictures, std::size_t count, double fps);

}  // namespace gs
