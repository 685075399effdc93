// SPDX-License-Identifier: Apache-2.0
// A job: one run to train out of many that are compared. What it is, what it brought, and whether its folder holds it
// already.
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
    std::string name;      ///< for messages
    TrainOptions options;  ///< validated; `model` is its own folder
};

/// Gives one of several runs its folder, and if there is options.tensorboard a folder of the same name in that.
void set_folder(TrainOptions& options, const std::filesystem::path& folder);

/// Returns the fields of a job's result that suite.json and tradeoff.json have.
nlohmann::ordered_json job_json(const RunResult& result);

/// Returns the result of the finished run in the folder `options.model`, with num_gaussians, train_seconds,
/// frame_seconds, and as `bytes` the size of the point cloud file, or of the file that a size limit is for. Empty if
/// the folder holds no run of these (validated) options that has all this. Options that change neither model nor
/// figures (messages, image cache, saving along the way) may differ.
std::optional<RunResult> finished_job(const TrainOptions& options);

/// Says how the run in the folder `options.model` differs from `options`: "resolution 80, now 160". Empty if it does
/// not differ and where the folder holds no run.
std::string difference_to_run(const TrainOptions& options);

/// Throws UsageError for `--appearance auto`: runs that are compared must not each choose a model of their own.
void require_named_appearance(const TrainOptions& options);

/// Limits the number of Gaussians to `share` of --cap-max, and the random initial points to the same number: MCMC never
/// removes what it begins with.
void limit_budget(TrainOptions& options, double share);

}  // namespace gs
