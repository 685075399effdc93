// SPDX-License-Identifier: Apache-2.0
// The folder of a scene that `gsapp prepare` makes: how it comes into its place.
#pragma once

#include <filesystem>
#include <string>

namespace gs {

/// Checks whether a scene can be made at `scene`, before colmap runs for hours: it does not exist, holds nothing but
/// the log of a failure, or is a scene and `overwrite` is set. Throws UsageError, also if one of the folders
/// `source` and `scene` holds the other.
void check_target(const std::filesystem::path& source, const std::filesystem::path& scene, bool overwrite);

/// Keeps images/ and sparse/ of the output of image_undistorter, moves the model to sparse/0/ and deletes the rest.
/// Throws DataError if colmap wrote no scene.
void arrange_scene(const std::filesystem::path& dense);

/// Puts the new scene in the place of an earlier one, which is removed only when the new one is safe on the disk, and
/// put back if that fails. Throws DataError and filesystem_error.
void put_in_place(const std::filesystem::path& scene, const std::filesystem::path& target);

/// Copies the log of a failure into the folder `target`, and returns what the message says about it.
std::string keep_failed_log(const std::filesystem::path& log, const std::filesystem::path& target);

}  // namespace gs
