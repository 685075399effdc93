// SPDX-License-Identifier: Apache-2.0
// Takes the sharpest frames of a video, with the `ffmpeg` program.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>

#include "lib/io/image.h"
#include "lib/scene/program_log.h"

namespace gs {

/// Returns the variance of the Laplacian of the image's luma: the larger, the sharper the picture of one and the same
/// thing. 0 for an image without inner pixels.
double sharpness(const Image& image);

/// Takes `fps` frames a second: of five candidates in each interval the sharpest, because a hand-held camera blurs
/// some. Writes them to `folder`, which is made, as frame_00000.jpg and so on, upright. `progress` is called with
/// candidates done and expected (0 if not known). Throws UsageError when ffmpeg is not installed, DataError for a video
/// that it cannot read or that gives fewer than two frames, Interrupted.
void extract_frames(const std::filesystem::path& video, double fps, const std::filesystem::path& folder,
                    ProgramLog& log, const std::function<void(std::int64_t done, std::int64_t total)>& progress);

}  // namespace gs
