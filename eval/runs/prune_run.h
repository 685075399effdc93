// SPDX-License-Identifier: Apache-2.0
// A finished run without the view-dependent parameters that do not show, as a new run beside it.
#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "eval/runs/saved_run.h"

namespace gs {

/// The mean scores over the test views.
struct PruneScores {
    double psnr = 0, ssim = 0;
};

struct PruneReport {
    std::string run = {};  ///< folder of the run that was pruned
    std::int64_t iteration = 0, num_gaussians = 0;
    std::int64_t pruned = 0;                             ///< Gaussians that lost their residual
    std::int64_t bytes_saved = 0;                        ///< size of their residuals
    std::size_t num_cameras = 0;                         ///< training views that were looked at
    std::string split_rule = {};                         ///< which views were held out
    std::optional<PruneScores> before = {}, after = {};  ///< empty: there are no test views
};

/// The folder of the pruned run where the user names none: RUN-pruned, also where RUN ends with a slash.
std::filesystem::path pruned_folder(const std::filesystem::path& run);

/// Prunes the run's model by its training views (shown_residuals), measures the test views before and after, and writes
/// the pruned run with pruned.json to `output`, whose folder must be missing or empty. The backend of `run` holds the
/// pruned model afterwards. Throws what shown_residuals throws, and DataError where a file
/// cannot be written.
PruneReport prune_run(SavedRun& run, const std::filesystem::path& output);

/// Returns the report as two sentences for readers.
std::string format_prune_report(const PruneReport& report);

/// Returns the report for programs: pruned.json.
nlohmann::ordered_json prune_report_json(const PruneReport& report);

}  // namespace gs
