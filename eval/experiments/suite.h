// SPDX-License-Identifier: Apache-2.0
// The suites of `gsapp bench suite`: their jobs, the training of these jobs (one after another or one per GPU), and a
// results table, updated after each job.
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
    std::string row;  ///< name of the varied setting: "MCMC 0.1x", "softplus, opacity rate auto"
    std::string appearance;
    Job job;
    std::optional<RunResult> result = {};
    std::string error = {};  ///< reason for a missing result; empty: the job was not reached
};

/// Returns the names of the suites.
/// densification: MCMC, MCMC with a tenth of --cap-max, ADC, ADC with Speedy-Splat's pruning.
/// activations: the four colour activations, each with opacity rate 0.05, 0.025 and auto.
std::vector<std::string> suite_names();

/// Returns the lines of a suite without results: all rows of the first appearance, then all rows of the second. `base`
/// must not be validated yet, so that "0 or -1 = by strategy" is resolved by each job's own strategy. The settings that
/// the suite varies are overwritten, and `eval` is on. Folders are <base.model>/<row>-<appearance>. Throws UsageError
/// for an unknown suite, and the errors of validate.
std::vector<SuiteLine> suite_lines(const std::string& suite, const std::vector<std::string>& appearances,
                                   const TrainOptions& base);

/// Returns a table with one line per finished job, and a list of the other jobs.
std::string format_suite(const std::vector<SuiteLine>& lines, TableStyle style = TableStyle::kMarkdown);

/// Returns all results as JSON.
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
/// writes suite.md and suite.json after each. `base` as for suite_lines. A failed run does not stop the others; the
/// summary counts failures. Throws UsageError for invalid arguments, before anything is written, and the errors of
/// write_suite and `run`. Call catch_interrupts() before.
SuiteRun run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base,
                   const JobsRunner& run = run_jobs);

}  // namespace gs
