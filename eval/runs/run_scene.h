// SPDX-License-Identifier: Apache-2.0
// The scene of a run: loads it and checks that it is still the scene that the run was trained on. Also collects the
// options that make two runs the same experiment.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the options that determine the trained model, as text by key: all options except messages, folders,
/// intermediate saving and the seed. Paths are resolved, so that one scene named in two ways counts as one. Two runs
/// with equal maps differ only by chance.
std::map<std::string, std::string> training_options(const TrainOptions& options);

/// Describes the first difference between `scene`, loaded with these options, and the scene that the run was started
/// with (cameras.json): in images, split, sizes or cameras, naming the image. Sizes and split are compared only if the
/// options equal the run's own. Cameras differ if they deviate by more than rounding (a tenth of a pixel). Empty if
/// there is no difference, and for runs of older versions, which have no such list. Throws DataError for files that
/// cannot be read.
std::string difference_to_scene(const std::filesystem::path& run_folder, const TrainOptions& options,
                                const Scene& scene);

/// Throws DataError if the scenes differ (difference_to_scene), naming the difference and its remedy.
void require_run_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const Scene& scene);

/// Loads the scene of a run, with the cameras that it learned. Throws DataError if the scene is no longer at the run's
/// path, and the errors of require_run_scene and load_scene.
Scene load_run_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const LoadRules& rules);

/// Returns whether the scene options.source is a different scene than the run's own: by path if the run's scene still
/// exists, else by difference_to_scene; true if that has nothing to compare with.
bool is_other_scene(const std::filesystem::path& run_folder, const TrainOptions& options, const Scene& scene);

}  // namespace gs
