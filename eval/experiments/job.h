// SPDX-License-Identifier: Apache-2.0
// A job: one run to train out of many that are compared. What it is, what it brought, and whether its folder holds it
// already.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "lib/core/train_options.h"

namespace gs {

/// A run to train.
struct Job {
    std::string name;      ///< for messages
    TrainOptions options;  ///< validated; `model` is its own folder
};

/// Gives one of several runs its folder, and where there is options.tensorboard a folder of the same name in that.
void set_folder(TrainOptions& options, const std::filesystem::path& folder);

/// Scores and costs of a job whose run has finished.
struct JobResult {
    double psnr = 0, ssim = 0;  ///< psnr may be infinite
    std::int64_t num_gaussians = 0;
    double train_seconds = 0;
    double frame_seconds = 0;  ///< mean over the test views, at their size
    std::int64_t bytes = 0;    ///< size of the point cloud file, or of the file that a size limit is for
    std::optional<std::int64_t> peak_device_bytes = {};  ///< most memory of the GPU while training; empty on the CPU
    std::string protocol = {};                           ///< protocol_line of the scores
};

/// Returns scores and costs by the keys that suite.json and tradeoff.json use. An infinite PSNR becomes null: JSON
/// knows no infinity.
nlohmann::ordered_json result_json(const JobResult& result);

/// Returns the result of the finished run in the folder `options.model`, or nothing if the folder holds none of these
/// (validated) options. Options that change neither model nor figures (messages, image cache, saving along the way) may
/// differ.
std::optional<JobResult> finished_job(const TrainOptions& options);

/// Says how the run in the folder `options.model` differs from `options`: "resolution 80, now 160". Empty where it does
/// not differ and where the folder holds no run.
std::string difference_to_run(const TrainOptions& options);

/// Throws UsageError for `--appearance auto`: runs that are compared must not each choose a model of their own.
void require_named_appearance(const TrainOptions& options);

/// Limits the number of Gaussians to `share` of --cap-max, and the random initial points to the same number: MCMC never
/// removes what it begins with.
void limit_budget(TrainOptions& options, double share);

}  // namespace gs
