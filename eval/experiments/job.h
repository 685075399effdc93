// SPDX-License-Identifier: Apache-2.0
// A job: one training run out of many that are compared. Defines its options, its result, and the check whether its
// folder already holds that result.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "eval/runs/run_result.h"
#include "lib/core/train_options.h"

namespace gs {

/// A run to train.
struct Job {
    std::string name;      ///< name for messages
    TrainOptions options;  ///< validated options; `model` is the job's own folder
};

/// Sets the folder of one of several runs; if options.tensorboard is set, also a subfolder of the same name there.
void set_folder(TrainOptions& options, const std::filesystem::path& folder);

/// Returns the fields of a job's result that suite.json and tradeoff.json have.
nlohmann::ordered_json job_json(const RunResult& result);

/// Returns the result of the finished run in the folder `options.model`, with num_gaussians, train_seconds,
/// frame_seconds, and as `bytes` the size of the point cloud file or of the file that a size limit applies to. Empty if
/// the folder holds no run of these (validated) options with all these values. Options that change neither model nor
/// results (messages, image cache, intermediate saving) may differ.
std::optional<RunResult> finished_job(const TrainOptions& options);

/// Describes how the run in the folder `options.model` differs from `options`: "resolution 80, now 160". Empty if there
/// is no difference or no run in the folder.
std::string difference_to_run(const TrainOptions& options);

/// Throws UsageError for `--appearance auto`: compared runs must not each choose their own model.
void require_named_appearance(const TrainOptions& options);

/// Limits the number of Gaussians to `share` of --cap-max, and the random initial points to the same number: MCMC never
/// removes initial points.
void limit_budget(TrainOptions& options, double share);

}  // namespace gs
