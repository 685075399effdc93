// SPDX-License-Identifier: Apache-2.0
// What lies in a folder of photographs, and its upright copy.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace gs {

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
