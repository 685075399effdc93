// SPDX-License-Identifier: Apache-2.0
// The suites of `gsapp bench suite`: the jobs that each is made of, their training, one after another or one on each
// GPU, and the table over them, written after each.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/job.h"
#include "eval/experiments/job_runner.h"
#include "eval/pages/text_table.h"

namespace gs {

/// One job of a suite as a line of its table.
struct SuiteLine {
    std::string row;  ///< what the suite varies: "MCMC 0.1x", "softplus, opacity rate auto"
    std::string appearance;
    Job job;
    std::optional<RunResult> result = {};
    std::string error = {};  ///< why there is no result; empty: the job was not reached
};

/// Returns the names of the suites.
/// densification: MCMC, MCMC with a tenth of --cap-max, ADC, ADC with Speedy-Splat's pruning.
/// activations: the four colour activations, each with opacity rate 0.05, 0.025 and auto.
std::vector<std::string> suite_names();

/// Returns the lines of a suite without results: all rows of the first appearance, then all of the second. `base` is
/// not validated, so that every job decides what "0 or -1 = by strategy" means by its own strategy. What the suite
/// varies is overwritten, and `eval` is on. Folders are <base.model>/<row>-<appearance>. Throws UsageError for an
/// unknown suite, and where validate does.
std::vector<SuiteLine> suite_lines(const std::string& suite, const std::vector<std::string>& appearances,
                                   const TrainOptions& base);

/// Returns a table, one line a job with a result, and a list of the other jobs.
std::string format_suite(const std::vector<SuiteLine>& lines, TableStyle style = TableStyle::kMarkdown);

/// Returns all figures as JSON.
std::string suite_json(const std::string& suite, const std::vector<SuiteLine>& lines);

/// Writes suite.md and suite.json to the folder, each atomically. Throws DataError.
void write_suite(const std::filesystem::path& folder, const std::string& suite, const std::vector<SuiteLine>& lines);

/// A suite after its jobs were trained.
struct SuiteRun {
    std::filesystem::path folder;  ///< holds suite.md, suite.json and the jobs' folders
    std::vector<SuiteLine> lines;
    JobsSummary summary;
};

/// Trains the jobs of a suite that its folder `base.model` (empty: output/<scene>-<suite>) does not hold yet, and
/// writes suite.md and suite.json after each. `base` as for suite_lines. A run that fails does not stop the others: the
/// summary tells. Throws UsageError for mistakes in the arguments, before anything is written, and what write_suite and
/// `run` throw. Call catch_interrupts() before.
SuiteRun run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base,
                   const JobsRunner& run = run_jobs);

}  // namespace gs
