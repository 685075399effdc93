// SPDX-License-Identifier: Apache-2.0
// Arranges the scene folder that `gsapp prepare` makes and moves it into place.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// Checks that a scene can be made at `scene`, before colmap runs for hours. The folder may be missing, may hold only
/// the log of a failure, or may be a scene if `overwrite` is set. Throws UsageError otherwise, and if one of the
/// folders `source` and `scene` contains the other.
void check_target(const std::filesystem::path& source, const std::filesystem::path& scene, bool overwrite);

/// Keeps images/ and sparse/ of the output of image_undistorter, moves the model to sparse/0/ and deletes all other
/// files. Throws DataError if colmap wrote no scene.
void arrange_scene(const std::filesystem::path& dense);

/// Moves the new scene to `target`. An earlier scene there is removed only once the new one is safely on disk, and
/// restored if that fails. Throws DataError and filesystem_error.
void put_in_place(const std::filesystem::path& scene, const std::filesystem::path& target);

/// Copies the log of a failure into the folder `target`, and returns the part of the error message that names it.
std::string keep_failed_log(const std::filesystem::path& log, const std::filesystem::path& target);

}  // namespace gs
