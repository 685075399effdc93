// SPDX-License-Identifier: Apache-2.0
// From the options of a run to those of the scene loader.
#pragma once

#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// The part of the options that says which images are loaded, how, and which of them are test views. Used by training
/// and, with a stored configuration, by evaluation, so that both see the same scene.
SceneOptions scene_options(const TrainOptions& options);

/// Name of the scene for folders and tables: of a built-in scene what follows "builtin:", else the name of its folder.
std::string scene_name(const std::string& source);

/// Name of the dataset that the scene belongs to: "builtin", else the name of the folder that the scene's folder lies in.
std::string dataset_name(const std::string& source);

}  // namespace gs
