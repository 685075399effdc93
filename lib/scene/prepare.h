// SPDX-License-Identifier: Apache-2.0
// Makes a scene folder from photographs with the `colmap` program.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace gs {

struct PrepareOptions {
    std::filesystem::path images;         ///< folder of photographs, sub-folders included
    std::filesystem::path scene;          ///< folder to make: images/ and sparse/0/
    std::string camera_model = "OPENCV";  ///< lens model of the photographs; the scene's cameras are PINHOLE
    std::string matcher = "exhaustive";   ///< exhaustive | sequential
    bool gpu = false;                     ///< let colmap use the GPU for features and matches
    bool overwrite = false;               ///< replace an earlier scene at `scene`
};

/// Reports progress: stage 1..stages, its name, and colmap's own count ("3/67") or "".
using PrepareProgress = std::function<void(int stage, int stages, const std::string& name, const std::string& count)>;

/// Runs colmap's feature extraction, matching, mapper and undistortion, with options that colmap 3.8 and others have.
/// Photographs with an EXIF orientation are turned upright first, in copies, because colmap ignores the tag; unless
/// upright and level ones would then no longer have one size and share one camera.
/// Works in a temporary folder beside the target, which gets its name only when it is complete. Uses the reconstruction
/// with most images.
/// Throws UsageError when colmap is not installed and for a target that exists (without `overwrite`, or that is no
/// scene, or that holds the photographs); DataError for a folder without photographs and, with colmap's last lines,
/// when colmap fails; Interrupted when the user stopped it.
void prepare_scene(const PrepareOptions& options, const PrepareProgress& progress);

}  // namespace gs
