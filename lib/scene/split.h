// SPDX-License-Identifier: Apache-2.0
// The splits that datasets state themselves: lists of names, and folders of images.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "lib/scene/source_scene.h"
#include "lib/scene/transforms_reader.h"

namespace gs {

/// Reads a text file of names, one a line; lines of comments (#) are empty. Throws DataError if it cannot be read.
std::vector<std::string> read_name_list(const std::filesystem::path& file);

/// Returns the roles of a file's frames by its lists, and describes the split in scene.given_split and scene.notes:
/// test_filenames are test views; if they name no frame, val_filenames take their place, which otherwise neither train
/// nor test. With train_filenames no other frames train.
std::vector<ViewRole> roles_of_frames(const TransformsFile& file, SourceScene& scene);

/// Leaves out the frames that are marked is_bad, and notes them. `where` names their list.
void leave_out_bad(const std::vector<TransformsFrame>& frames, const std::string& where, std::vector<ViewRole>& roles,
                   std::vector<std::string>& notes);

/// Sets the roles of a scene without a split by the list `file` of test images, one name a line, if it is there and
/// names any of them. Throws DataError if it cannot be read.
void apply_test_file(const std::filesystem::path& file, SourceScene& scene);

/// Sets the roles of a scene without a split by the folders of its images, if all lie in folders named train, and test
/// or val.
void apply_folder_split(SourceScene& scene);

}  // namespace gs
