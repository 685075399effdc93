// SPDX-License-Identifier: Apache-2.0
// Derives the scene loader's options and the scene's names from a run's options.
#pragma once

#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the options that determine which images are loaded, how, and which of them are test views. Training and,
/// with a stored configuration, evaluation use it, so that both see the same scene.
SceneOptions scene_options(const TrainOptions& options);

/// Returns the scene's name for folders and tables: that of its folder, or what follows "builtin:" (of a file its
/// stem).
std::string scene_name(const std::string& source);

/// Returns the name of the scene's dataset: "builtin", or the name of the folder that contains the scene's folder.
std::string dataset_name(const std::string& source);

}  // namespace gs
