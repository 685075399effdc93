// SPDX-License-Identifier: Apache-2.0
// Options that commands share: by which they spread a model over several ranks without training it, and by which they
// open a point cloud that has no run, whose configuration would have said them.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "eval/runs/saved_run.h"
#include "lib/core/options_cli.h"
#include "lib/train/group_backend.h"

namespace gs {

/// Adds --ranks. Returns the option.
CLI::Option* add_ranks_option(CLI::App& command, int& ranks);

/// Joins `ranks` processes of this command and gives each its part of the CPU threads, `threads` of them or for 0 of
/// all. `subject` is what the command is called for (RankGroup::join). Rank 0 then goes on; the others have to call
/// follow_command(group, started_as(command)). Returns null for one rank. Throws what RankGroup::join throws.
std::unique_ptr<RankGroup> join_ranks(int ranks, const std::string& command, const std::string& subject,
                                      int threads = 0);

/// Whether SceneArguments declares --device, or the command has one of its own.
enum class DeviceOption { kDeclared, kOfCommand };

/// The options by which a command opens a point cloud that has no run.
class SceneArguments {
  public:
    /// Declares --source, described by `source_help`, and the options of the same names as those of a training that
    /// say how its views are loaded. The object must live until `changes` was called.
    SceneArguments(CLI::App& command, const std::string& source_help, DeviceOption device);

    /// Returns what open_saved_run is to change for these runs and point clouds. Test views of a point cloud's scene
    /// are held out unless --eval=false says otherwise. Throws UsageError for a wrong value, and if there is no
    /// point cloud, for options that only one takes, unless the runs were trained with the same values.
    RunChanges changes(const std::vector<std::string>& runs) const;

  private:
    TrainArguments arguments_;
};

}  // namespace gs
