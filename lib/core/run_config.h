// SPDX-License-Identifier: Apache-2.0
// The options that are stored with a run, whose files are found from any folder and after run and scene have moved.
#pragma once

#include <string>

#include "lib/core/train_options.h"

namespace gs {

/// Returns `path` from the root on, without dots and a slash at the end. "builtin:NAME", an empty text, and any path
/// while there is no current folder, stay as they are.
std::string absolute_path(const std::string& path);

/// Returns `options` with absolute_path of all files and folders that they name.
TrainOptions with_absolute_paths(TrainOptions options);

/// Returns whether there is something at `source`, the scene of a run. Built-in scenes are always there.
bool scene_exists(const std::string& source);

/// Returns the text of config.yaml of a run: all options, with absolute paths. Together with the path of the run's own
/// folder, which is one of them, they also tell where a file lies relative to the run. load_run_options
/// (lib/core/options.h) reads it back.
std::string run_config(const TrainOptions& options);

}  // namespace gs
