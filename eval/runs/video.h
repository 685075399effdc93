// SPDX-License-Identifier: Apache-2.0
// Makes videos of pictures with the program ffmpeg.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Checks, before anything is rendered, that a video of these views can be made. Throws UsageError for a name that ends
/// neither in .mp4 nor in .webm, for pictures of different sizes or of fewer than 2x2 pixels, and if ffmpeg is not
/// installed.
void require_video(const std::filesystem::path& video, const std::vector<View>& views);

/// Makes a video of the pictures 00000.png, ..., of a folder: H.264 or VP9, by the ending of the name, with 8 bits and
/// colour at half the resolution, as every player shows it. Such videos have even sizes, so an odd last row or column
/// is cut off. An earlier video of this name is replaced. Throws DataError with ffmpeg's last lines if it fails, and
/// Interrupted.
void make_video(const std::filesystem::path& video, const std::filesystem::path& pictures, std::size_t count,
                double fps);

}  // namespace gs
