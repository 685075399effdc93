// SPDX-License-Identifier: Apache-2.0
// Options shared by several commands: the number of ranks that hold a model without training it, and the scene options
// for a point cloud, which has no run configuration.
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

/// Joins `ranks` processes of this command and assigns each its share of `threads` CPU threads (0: all). `subject`
/// names the input of the command (RankGroup::join). Rank 0 then continues; the others must call follow_command(group,
/// started_as(command)). Returns null for one rank. Throws the errors of RankGroup::join.
std::unique_ptr<RankGroup> join_ranks(int ranks, const std::string& command, const std::string& subject,
                                      int threads = 0);

/// Whether SceneArguments declares --device, or the command has its own.
enum class DeviceOption { kDeclared, kOfCommand };

/// The options with which a command opens a point cloud without a run.
class SceneArguments {
  public:
    /// Declares --source, described by `source_help`, and the training options that control how its views are loaded,
    /// under the same names. The object must live until `changes` has been called.
    SceneArguments(CLI::App& command, const std::string& source_help, DeviceOption device);

    /// Returns the changes for open_saved_run for these runs and point clouds. Test views of a point cloud's scene are
    /// held out unless --eval=false is given. Throws UsageError for an invalid value. If there is no point cloud, also
    /// throws UsageError for options that apply only to point clouds, unless the runs were trained with the same
    /// values.
    RunChanges changes(const std::vector<std::string>& runs) const;

  private:
    TrainArguments arguments_;
};

}  // namespace gs
