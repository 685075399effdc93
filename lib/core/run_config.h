// SPDX-License-Identifier: Apache-2.0
// The options stored with a run. Their files are found from any current folder, and after run and scene have moved
// together.
#pragma once

#include <string>

#include "lib/core/train_options.h"

namespace gs {

/// Returns the absolute form of `path`, without dots or a trailing slash. Leaves "builtin:NAME" and an empty text
/// unchanged, and any path if there is no current folder.
std::string absolute_path(const std::string& path);

/// Returns `options` with absolute_path() applied to all their files and folders.
TrainOptions with_absolute_paths(TrainOptions options);

/// Returns whether `source`, the scene of a run, exists. Built-in scenes always exist.
bool scene_exists(const std::string& source);

/// Returns the text of config.yaml of a run: all options, with absolute paths. The paths include the run's own folder,
/// so the location of a file relative to the run can be recovered. load_run_options (lib/core/options.h) reads the
/// text.
std::string run_config(const TrainOptions& options);

}  // namespace gs
