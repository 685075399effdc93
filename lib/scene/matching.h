// SPDX-License-Identifier: Apache-2.0
// Chooses which pairs of photographs colmap compares.
#pragma once

#include <string>
#include <vector>

#include "lib/scene/prepare.h"
#include "lib/scene/programs.h"

namespace gs {

struct Matching {
    std::string command;                 ///< colmap's, as "exhaustive_matcher"
    std::vector<std::string> arguments;  ///< besides the database and the GPU
    std::string words;                   ///< for people: which pairs, and why
};

/// Returns whether the names differ in one number each and are in its order when they are sorted, as those of frames
/// and of a camera's photographs are. `names` are sorted.
bool numbered_in_order(const std::vector<std::string>& names);

/// Chooses by --matching or, without it, by the number of photographs: all pairs up to 300; above that neighbours of a
/// video, pairs that look alike if there is a vocabulary tree, neighbours of numbered names, all pairs. A video's
/// frames are always compared with their neighbours. Throws UsageError for a vocabulary tree that is missing.
Matching choose_matching(const PrepareOptions& options, const std::vector<std::string>& names, bool is_video,
                         ColmapProgram& colmap);

}  // namespace gs
