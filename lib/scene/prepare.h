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
    std::filesystem::path source;  ///< folder of photographs, sub-folders included, or a video file
    std::filesystem::path scene;   ///< folder to create, with images/ and sparse/0/
    std::optional<double> fps;     ///< frames per second to take from a video; empty = 2
    /// Lens model of the photographs. The scene's cameras are PINHOLE, or EQUIRECTANGULAR if this is.
    std::string camera_model = "OPENCV";
    std::string matching = "auto";     ///< auto | exhaustive | sequential | vocab-tree
    std::filesystem::path vocab_tree;  ///< vocabulary tree for vocab-tree; empty = an installed one
    std::optional<bool> gpu;           ///< compute features and matches on the GPU; empty = if colmap can
    bool overwrite = false;            ///< replace an earlier scene at `scene`

    /// Returns whether the photographs are panoramas, of 360 by 180 degrees.
    bool is_panorama() const { return camera_model == "EQUIRECTANGULAR"; }
};

/// The result of prepare_scene.
struct PrepareReport {
    bool is_video = false;
    bool is_panorama = false;  ///< as in PrepareOptions
    std::size_t photographs = 0, registered = 0, points = 0;
    std::optional<double> error;        ///< mean reprojection error in pixels, if colmap reports it
    std::vector<std::string> left_out;  ///< the photographs that were not registered, sorted
    /// Numbers of photographs, or of faces of panoramas, in colmap's other reconstructions, which are not used, largest
    /// first.
    std::vector<std::size_t> other_models;
    std::vector<std::string> notes;  ///< about unsupported formats, and disagreement of panoramas' faces
    std::filesystem::path log;       ///< output of colmap and ffmpeg
};

/// Reports progress: stage 1..stages, its name, and a count ("3/67") or "".
using PrepareProgress = std::function<void(int stage, int stages, const std::string& name, const std::string& count)>;

/// Runs colmap's feature extraction, matching, mapper and undistortion; supports colmap 3.8 to 4.x. For a video, ffmpeg
/// first extracts the frames (lib/scene/photographs.h). Photographs with an EXIF orientation are first turned upright,
/// in copies, because colmap ignores the tag; they are not turned if portrait and landscape photographs would then no
/// longer have one size and share one camera. Of photographs of 360 degrees (EQUIRECTANGULAR), colmap gets pinhole
/// faces (lib/scene/panorama.h), and the scene holds them as they are. Works in a temporary folder beside the target,
/// which is renamed only when it is complete. Uses the reconstruction with the most images. The programs' output is
/// kept in the scene folder: in colmap.log, or if a program fails in colmap-failed.log, which the message names. Throws
/// UsageError if colmap is not installed, if it cannot use the given --gpu, or if the target exists (without
/// `overwrite`, or if it is not a scene or holds the photographs); DataError for a folder without photographs and, with
/// colmap's last lines, if colmap fails; Interrupted if the user stopped it.
PrepareReport prepare_scene(const PrepareOptions& options, const PrepareProgress& progress);

/// Returns the report in sentences: photographs registered, photographs left out, and unused reconstructions.
std::vector<std::string> describe(const PrepareReport& report);

/// Returns whether fewer than 90 % of the photographs were registered, so that the user should check the others.
bool is_poor(const PrepareReport& report);

}  // namespace gs
