// SPDX-License-Identifier: Apache-2.0
// Repeats a training with several seeds, for means and deviations.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "eval/runs/results.h"
#include "lib/core/train_options.h"

namespace gs {

/// Trains one run with these options and returns its result; empty if nothing was scored.
using TrainRun = std::function<std::optional<RunResult>(const TrainOptions&)>;

/// Trains `num_runs` runs with the seeds base.seed, base.seed + 1, ... in the folders <base.model>-0, <base.model>-1,
/// ... (empty: free ones in output/), and returns their results. Finished runs are not trained again unless
/// `base.overwrite`. Throws UsageError for `base.resume`, for `--appearance auto` and without `base.eval`, DataError if
/// the scene is no longer that of a finished run, and the errors of `train`.
std::vector<RunResult> train_seeds(TrainOptions base, int num_runs, const TrainRun& train);

}  // namespace gs
