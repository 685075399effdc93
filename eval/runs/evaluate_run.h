// SPDX-License-Identifier: Apache-2.0
// Scores the test views of a finished run and writes its results.
#pragma once

#include <filesystem>
#include <string>

#include "eval/runs/saved_run.h"

namespace gs {

/// Returns the folder of a run's results: the run's own folder, or RUN/on-SCENE-LENS for the views of another scene or
/// through another lens, whose results are kept separate.
std::filesystem::path results_folder(const std::filesystem::path& run, const RunChanges& changes);

/// Scores the test views of `run` with `options` (evaluate_views) and writes results.json and per_view.json to
/// `results`, with the mean frame time over `frame_rounds` rounds through the views unless that is 0. Logs the metrics
/// that could not be measured. Images and results appear only after all have been computed. Throws the errors of
/// evaluate_views and write_results.
RunResult evaluate_run(SavedRun& run, const EvalOptions& options, int frame_rounds,
                       const std::filesystem::path& results);

}  // namespace gs
