// SPDX-License-Identifier: Apache-2.0
// Lists a folder of photographs, makes its upright copy, and extracts the sharpest frames of a video with the `ffmpeg`
// program.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "lib/io/image.h"
#include "lib/scene/programs.h"

namespace gs {

/// Returns the variance of the Laplacian of the image's luma: of pictures of the same subject, the one with the larger
/// value is sharper. Returns 0 for an image without inner pixels.
double sharpness(const Image& image);

/// Extracts `fps` frames per second: the sharpest of five candidates in each interval, because a hand-held camera blurs
/// some frames. Creates `folder` and writes the frames to it, upright, as frame_00000.jpg and so on. `progress` is
/// called with the number of candidates done and expected (0 if unknown). Throws UsageError if ffmpeg is not installed,
/// DataError if it cannot read the video or the video gives fewer than two frames, and Interrupted if the user stopped
/// it.
void extract_frames(const std::filesystem::path& video, double fps, const std::filesystem::path& folder,
                    ProgramLog& log, const std::function<void(std::int64_t done, std::int64_t total)>& progress);

/// The files of a folder of photographs, by path relative to it.
struct Photographs {
    std::vector<std::string> names;  ///< files with an image extension, readable or not, sorted
    std::vector<std::string> masks;  ///< files named as masks of photographs, e.g. "1.jpg.mask.png"; not in `names`
    std::set<std::pair<int, int>> stored_sizes, upright_sizes;  ///< width and height, pixels
    std::vector<std::string> notes;                             ///< about photographs in unsupported formats
    /// Photographs whose EXIF orientation is not 1, and all other files.
    std::vector<std::filesystem::path> turned, others;

    /// Returns whether to turn the photographs upright. If a device's portrait and landscape photographs have two sizes
    /// once turned, they no longer share one camera in colmap. One camera per photograph is worse than pictures that
    /// lie on their side.
    bool should_turn() const { return !turned.empty() && upright_sizes.size() <= stored_sizes.size(); }
};

/// Searches the folder and its sub-folders. Throws DataError if there is no readable photograph.
Photographs find_photographs(const std::filesystem::path& images);

/// Writes upright copies of the photographs into `folder`, because colmap ignores their EXIF orientation. Turned
/// photographs are written anew; other files become links. Throws DataError, and Interrupted if the user stopped it.
void write_upright(const std::filesystem::path& images, const Photographs& photographs,
                   const std::filesystem::path& folder);

}  // namespace gs
