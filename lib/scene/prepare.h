// SPDX-License-Identifier: Apache-2.0
// Makes a scene folder from photographs or a video with the `colmap` program.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace gs {

struct PrepareOptions {
    std::filesystem::path source;         ///< folder of photographs, sub-folders included, or a video file
    std::filesystem::path scene;          ///< folder to make: images/ and sparse/0/
    std::optional<double> fps;            ///< frames a second to take from a video; empty = 2
    std::string camera_model = "OPENCV";  ///< lens model of the photographs; the scene's cameras are PINHOLE
    std::string matching = "auto";        ///< auto | exhaustive | sequential | vocab-tree
    std::filesystem::path vocab_tree;     ///< vocabulary tree for vocab-tree; empty = one that is installed
    std::optional<bool> gpu;              ///< compute features and matches on the GPU; empty = where colmap can
    bool overwrite = false;               ///< replace an earlier scene at `scene`
};

/// What came of the photographs.
struct PrepareReport {
    bool is_video = false;
    std::size_t photographs = 0, registered = 0, points = 0;
    std::optional<double> error;        ///< mean reprojection error in pixels, where colmap tells it
    std::vector<std::string> left_out;  ///< the photographs that were not registered, sorted
    /// The numbers of photographs in the other reconstructions that colmap made, largest first. They are not used.
    std::vector<std::size_t> other_models;
    std::vector<std::string> notes;  ///< about photographs that are not read
    std::filesystem::path log;       ///< all that colmap and ffmpeg printed
};

/// Reports progress: stage 1..stages, its name, and a count ("3/67") or "".
using PrepareProgress = std::function<void(int stage, int stages, const std::string& name, const std::string& count)>;

/// Runs colmap's feature extraction, matching, mapper and undistortion; colmap 3.8 to 4.x have the options. From a
/// video ffmpeg takes the frames first (lib/scene/photographs.h). Photographs with an EXIF orientation are turned
/// upright first, in copies, because colmap ignores the tag; unless upright and level ones would then no longer have
/// one size and share one camera. Works in a temporary folder beside the target, which gets its name only when it is
/// complete. Uses the reconstruction with most images. All that the programs print is kept in the scene folder: in
/// colmap.log, and when one fails in colmap-failed.log, which the message names. Throws UsageError when colmap is not
/// installed, for a --gpu that it cannot use and for a target that exists (without `overwrite`, or that is no scene, or
/// that holds the photographs); DataError for a folder without photographs and, with its last lines, when colmap fails;
/// Interrupted when the user stopped it.
PrepareReport prepare_scene(const PrepareOptions& options, const PrepareProgress& progress);

/// Returns the report in sentences: what was registered, what was left out, and which reconstructions were not used.
std::vector<std::string> describe(const PrepareReport& report);

/// Returns whether so few photographs were registered that the user should look at the others: less than 90 %.
bool is_poor(const PrepareReport& report);

}  // namespace gs
