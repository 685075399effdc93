// SPDX-License-Identifier: Apache-2.0
// Opens the run folder and the checkpoint to continue from, so that errors are reported before a scene is loaded.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/initialize.h"
#include "lib/model/run_folder.h"

namespace gs {

/// A run folder that the run may write to, and the checkpoint from which the run continues.
struct RunStart {
    RunFolder folder;
    std::optional<Checkpoint> checkpoint;
    /// The first lines of the training log of a new run, without their iteration
    std::vector<nlohmann::json> first_events = {};
    double used_seconds = 0;                   ///< part of a time limit that passed before the first step of a new run
    std::optional<InitialModel> initial = {};  ///< model that a new run begins with; empty: points
    /// The lock that keeps other runs out of the folder while any copy of the pointer exists
    std::shared_ptr<const RunLock> lock = {};
    /// The text of cameras.json with all views of the scene, including views that are held out for a target or cannot
    /// be decoded; empty: the scene's training and test views are all views
    std::string cameras = {};
};

/// Reads the checkpoint that `resume` names, or the model of `init` (before it may be overwritten), and locks and
/// prepares the folder `options.model`. `test_views` is the view_digest of the scene's test views; empty: not compared.
/// Throws DataError, also if the resumed run held out other test views. Throws UsageError, also if the checkpoint has
/// another appearance than the options, or if only one of the two has a target. On an error the folder is unchanged.
RunStart open_run(const TrainOptions& options, const std::string& test_views = {});

/// Throws UsageError if another run writes into the folder `options.model`, or if the folder holds files that this run
/// must not replace (lib/model/run_folder.h). Changes nothing, so that it can be called before the scene is loaded.
/// Throws DataError for a checkpoint that cannot be read.
void require_free_folder(const TrainOptions& options);

/// Returns the folder of the run whose checkpoint `resume` names. Throws DataError.
std::filesystem::path resumed_run(const TrainOptions& options);

/// Returns the frame of the checkpoint that `resume` names. Throws DataError.
Frame checkpoint_frame(const TrainOptions& options);

/// Returns the name of the appearance model in the checkpoint that `resume` names. Throws DataError.
std::string checkpoint_appearance(const TrainOptions& options);

}  // namespace gs
