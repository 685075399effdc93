// SPDX-License-Identifier: Apache-2.0
// Scores the test views of a finished run and writes its results.
#pragma once

#include <filesystem>
#include <string>

#include "eval/runs/saved_run.h"

namespace gs {

/// The folder of a run's results: the run's own, or RUN/on-SCENE for the views of another `source`, which are kept
/// apart.
std::filesystem::path results_folder(const std::filesystem::path& run, const std::string& source);

/// Scores the test views of `run` as `options` say (evaluate_views) and writes results.json and per_view.json to
/// `results`, with the mean frame time over `frame_rounds` rounds through the views unless that is 0. Says
/// in the log what could not be measured. Pictures and results appear when all are there. Throws what evaluate_views
/// and write_results throw.
RunResult evaluate_run(SavedRun& run, const EvalOptions& options, int frame_rounds,
                       const std::filesystem::path& results);

}  // namespace gs
