// SPDX-License-Identifier: Apache-2.0
// Chooses the pairs of photographs that colmap compares.
#pragma once

#include <string>
#include <vector>

#include "lib/scene/prepare.h"
#include "lib/scene/programs.h"

namespace gs {

struct Matching {
    std::string command;                 ///< colmap command, e.g. "exhaustive_matcher"
    std::vector<std::string> arguments;  ///< the command's arguments other than database and GPU
    std::string words;                   ///< the chosen pairs and the reason, in words
};

/// Returns whether the names differ only in one number and sorting them also sorts this number, as for video frames and
/// a camera's photographs. `names` must be sorted.
bool numbered_in_order(const std::vector<std::string>& names);

/// Chooses the matching by --matching. Without it, chooses all pairs for up to 300 photographs or 50 panoramas. Above
/// that it chooses the first that applies: neighbouring frames of a video, similar pairs if there is a vocabulary tree,
/// neighbours of numbered names, all pairs. A video's frames are always compared with their neighbours. Throws
/// UsageError if the vocabulary tree is missing.
Matching choose_matching(const PrepareOptions& options, const std::vector<std::string>& names, bool is_video,
                         ColmapProgram& colmap);

}  // namespace gs
