// SPDX-License-Identifier: Apache-2.0
// The scene of a run: where it is, and whether what is there is what the run was trained on; and the options that make
// two runs the same experiment.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the options that decide what a run becomes, as text by key: all but messages, folders, saving along the way
/// and the seed. Paths are resolved, so that one scene named in two ways counts as one. Two runs with equal maps
/// differ only by chance.
std::map<std::string, std::string> training_options(const TrainOptions& options);

/// Returns how `scene`, loaded with these options, differs from the one that the run was begun with (cameras.json): in
/// images, split, sizes or cameras, with the first image that does. Sizes count if the options ask for the run's own,
/// and the split likewise; cameras differ by more than rounding (a tenth of a pixel). Empty if it does not differ, and
/// for runs of older versions, which do not say. Throws DataError for files that cannot be read.
std::string difference_to_scene(const std::filesystem::path& run_folder, const TrainOptions& options,
                                const Scene& scene);

/// Throws DataError, naming the difference and what helps, if there is one.
void require_run_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const Scene& scene);

/// Loads the scene of a run. Throws DataError if it is no
/// longer where the run has it, what require_run_scene throws, and what load_scene throws.
Scene load_run_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const LoadRules& rules);

/// Returns whether the scene named by options.source is another one than the run's own: by its place if that one is
/// still there, else by difference_to_scene; true if that cannot tell.
bool is_other_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const Scene& scene);

}  // namespace gs
