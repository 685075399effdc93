// SPDX-License-Identifier: Apache-2.0
// The options by which a command opens a point cloud that has no run, whose configuration would have said them.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "eval/runs/saved_run.h"
#include "lib/core/options_cli.h"

namespace gs {

/// Whether SceneArguments declares --device, or the command has one of its own.
enum class DeviceOption { kDeclared, kOfCommand };

class SceneArguments {
  public:
    /// Declares --source, described by `source_help`, and the options of the same names as those of a training that
    /// say how its views are loaded. The object must live until `changes` was called.
    SceneArguments(CLI::App& command, const std::string& source_help, DeviceOption device);

    /// Returns what open_saved_run is to change for these runs and point clouds. Test views of a point cloud's scene
    /// are held out unless --eval=false says otherwise. Throws UsageError for a wrong value, and, where there is no
    /// point cloud, for options that only one takes, unless the runs were trained with the same values.
    RunChanges changes(const std::vector<std::string>& runs) const;

  private:
    TrainArguments arguments_;
};

}  // namespace gs
