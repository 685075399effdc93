// SPDX-License-Identifier: Apache-2.0
// One training out of many that are compared: what it brought, and whether its folder holds it already.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "lib/core/train_options.h"

namespace gs {

/// Scores and costs of a finished run.
struct CellResult {
    double psnr = 0, ssim = 0;  ///< psnr may be infinite
    std::int64_t num_gaussians = 0;
    double train_seconds = 0;
    double frame_seconds = 0;  ///< mean of a frame at the test views' size
    std::int64_t bytes = 0;    ///< of the point cloud file
    std::optional<std::int64_t> peak_device_bytes;  ///< of training on a GPU
    std::string protocol;      ///< protocol_line of the scores
};

/// The scores and costs by the keys of results of suites and trade-offs. JSON knows no infinity: such a PSNR is null.
nlohmann::ordered_json result_json(const CellResult& result);

/// The result of these validated options if the folder `options.model` holds a finished run of them; empty otherwise. Options that
/// change neither model nor figures (messages, image cache, saving along the way) may differ.
std::optional<CellResult> finished_cell(const TrainOptions& options);

/// In what the run in the folder `options.model` differs from `options`, "resolution 80, now 160"; empty when it does not, or the folder
/// holds none.
std::string difference_to_run(const TrainOptions& options);

/// Throws UsageError for `--appearance auto`: runs that are compared must not each choose a model of their own.
void require_named_appearance(const TrainOptions& options);

/// Limits the number of Gaussians to that share of --cap-max, and random initial points with it: MCMC keeps what is there to begin with.
void limit_budget(TrainOptions& options, double share);

}  // namespace gs
