// SPDX-License-Identifier: Apache-2.0
// Opens the run folder and the checkpoint to continue from, so that errors show before a scene is loaded.
#pragma once

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "lib/core/train_options.h"
#include "lib/model/checkpoint.h"
#include "lib/model/initialize.h"
#include "lib/model/run_folder.h"

namespace gs {

/// A run folder that may be written, and the checkpoint from which the run continues.
struct RunStart {
    RunFolder folder;
    std::optional<Checkpoint> checkpoint;
    /// The first line of the training log of a new run, without its iteration; null = none
    nlohmann::json first_event = {};
    double used_seconds = 0;                   ///< of a time limit, that passed before the first step of a new run
    std::optional<InitialModel> initial = {};  ///< the model that a new run begins with, if not with points
    /// Keeps other runs out of the folder as long as somebody holds it
    std::shared_ptr<const RunLock> lock = {};
    /// The text of cameras.json with all views of the scene, also those that are held out for a target or cannot be
    /// decoded; empty: the views that train and test are all
    std::string cameras = {};
};

/// Reads the checkpoint that `resume` names, or the model of `init` (before it may be overwritten), and locks and
/// prepares the folder `options.model`. `test_views` is the view_digest of the scene's test views; empty: not compared.
/// Throws DataError, also if the resumed run held out other test views, and UsageError, also for a checkpoint of
/// another appearance than the options name or with a target where they have none; the folder is then unchanged.
RunStart open_run(const TrainOptions& options, const std::string& test_views = {});

/// Throws UsageError if another run writes into the folder `options.model`, or if it holds what this run must not
/// replace (lib/model/run_folder.h). Changes nothing, so that it can be asked before the scene is loaded. Throws
/// DataError for a checkpoint that cannot be read.
void require_free_folder(const TrainOptions& options);

/// Returns the folder of the run whose checkpoint `resume` names. Throws DataError.
std::filesystem::path resumed_run(const TrainOptions& options);

/// Returns the frame of the checkpoint that `resume` names. Throws DataError.
Frame checkpoint_frame(const TrainOptions& options);

/// Returns the name of the model in the checkpoint that `resume` names. Throws DataError.
std::string checkpoint_appearance(const TrainOptions& options);

}  // namespace gs
