// SPDX-License-Identifier: Apache-2.0
// What lies in a folder of photographs, its upright copy, and the sharpest frames of a video, which the `ffmpeg`
// program takes.
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

/// Returns the variance of the Laplacian of the image's luma: the larger, the sharper the picture of one and the same
/// thing. 0 for an image without inner pixels.
double sharpness(const Image& image);

/// Takes `fps` frames a second: of five candidates in each interval the sharpest, because a hand-held camera blurs
/// some. Writes them to `folder`, which is made, as frame_00000.jpg and so on, upright. `progress` is called with
/// candidates done and expected (0 if not known). Throws UsageError when ffmpeg is not installed, DataError for a video
/// that it cannot read or that gives fewer than two frames, Interrupted.
void extract_frames(const std::filesystem::path& video, double fps, const std::filesystem::path& folder,
                    ProgramLog& log, const std::function<void(std::int64_t done, std::int64_t total)>& progress);

/// The files of a folder of photographs, by path relative to it.
struct Photographs {
    std::vector<std::string> names;  ///< files with the extension of an image, readable or not, sorted
    std::vector<std::string> masks;  ///< masks of photographs by their names, as "1.jpg.mask.png"; not among the others
    std::set<std::pair<int, int>> stored_sizes, upright_sizes;  ///< width and height, pixels
    std::vector<std::string> notes;                             ///< about photographs in formats that are not read
    /// Photographs whose EXIF orientation is not 1; all other files.
    std::vector<std::filesystem::path> turned, others;

    /// Upright and level photographs of one device have two sizes once turned, and would no longer share one camera for
    /// colmap. A camera for each photograph is worse than pictures that lie on their side.
    bool should_turn() const { return !turned.empty() && upright_sizes.size() <= stored_sizes.size(); }
};

/// Looks through the folder and its sub-folders. Throws DataError when there is no readable photograph.
Photographs find_photographs(const std::filesystem::path& images);

/// Writes the photographs into `folder` as they are to be looked at, because colmap ignores their EXIF orientation:
/// those that have one turned, the other files as links. Throws DataError, and Interrupted when the user stopped it.
void write_upright(const std::filesystem::path& images, const Photographs& photographs,
                   const std::filesystem::path& folder);

}  // namespace gs
