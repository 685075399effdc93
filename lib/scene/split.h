// SPDX-License-Identifier: Apache-2.0
// Reads the splits that datasets define themselves: lists of names, and folders of images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/source_scene.h"
#include "lib/scene/transforms_reader.h"

namespace gs {

/// Reads a text file of names, one per line. Comment lines (#) give empty names. Throws DataError if it cannot be read.
std::vector<std::string> read_name_list(const std::filesystem::path& file);

/// Returns the roles of a file's frames according to its lists, and describes the split in scene.given_split and
/// scene.notes. Frames in test_filenames are test views; if the file names no test frame, val_filenames takes its
/// place. Otherwise frames in val_filenames are left out. If train_filenames names any frame, no other frames are used
/// for training.
std::vector<ViewRole> roles_of_frames(const TransformsFile& file, SourceScene& scene);

/// Sets the role of frames marked is_bad to left out, and adds a note. `where` names their list.
void leave_out_bad(const std::vector<TransformsFrame>& frames, const std::string& where, std::vector<ViewRole>& roles,
                   std::vector<std::string>& notes);

/// Sets the roles of a scene without a split from the list `file` of test images, one name per line, if the file exists
/// and names any of the scene's images. Throws DataError if it cannot be read.
void apply_test_file(const std::filesystem::path& file, SourceScene& scene);

/// Sets the roles of a scene without a split from the folders of its images, if all images lie in folders named train
/// and test or val.
void apply_folder_split(SourceScene& scene);

}  // namespace gs
