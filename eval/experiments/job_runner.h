// SPDX-License-Identifier: Apache-2.0
// Trains many runs as processes of this program, one after another or one per GPU, and skips runs that are already
// finished. Several callers with the same jobs, on any machines that share the folders, divide the jobs among
// themselves, and each receives all results.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/job.h"
#include "kernels/base/error.h"

namespace gs {

/// The outcome of one job: a result, an error, or neither if the user or the deadline stopped it.
struct JobOutcome {
    std::optional<RunResult> result = {};
    std::string error = {};
    ExitCode code = ExitCode::kOk;
    /// Seconds from start to end of the process; empty if this call did not train the job.
    std::optional<double> wall_seconds = {};
};

/// Callbacks and settings of the caller. Callbacks never overlap.
struct JobHooks {
    /// Receives every job that has ended, starting with jobs that were finished before. An exception stops all jobs and
    /// propagates from run_jobs.
    std::function<void(std::size_t job, const JobOutcome&)> done;
    /// Picks the next job to train from the pending jobs that no other process works on, given in their order; returns
    /// nothing if none should start now. Without this callback the first pending job is next.
    std::function<std::optional<std::size_t>(const std::vector<std::size_t>& pending)> choose = {};
    /// Time at which running jobs are stopped and after which none is started.
    std::optional<std::chrono::steady_clock::time_point> deadline = {};
    /// Program that trains, called as `program train --config FILE --time-frames N [--overwrite]`; empty: this program.
    std::filesystem::path program = {};
    /// Time without renewal of its claim after which a process that works on a job counts as dead.
    std::chrono::milliseconds stale_after = std::chrono::seconds(60);
};

/// The combined outcome of all jobs.
struct JobsSummary {
    int num_failed = 0;
    ExitCode first_code = ExitCode::kOk;  ///< exit code of the first failure
    bool interrupted = false;             ///< whether the user stopped the runs before all were trained
};

/// Trains the jobs whose folders do not hold them yet, or all jobs with the option `overwrite`. All jobs use the same
/// device. If another process works on a job, waits for it, and takes the job over if that process is gone. A failed
/// run does not stop the others; the processes running at that time do not retry it, later ones do. Once interrupted()
/// is true, no job is started, and running jobs write their checkpoint and end. `done` is not called for jobs that were
/// not reached. Call catch_interrupts() before. Throws DeviceError for a missing device.
JobsSummary run_jobs(const std::vector<Job>& jobs, const JobHooks& hooks);

/// A function that trains jobs: run_jobs, or a substitute in tests.
using JobsRunner = std::function<JobsSummary(const std::vector<Job>&, const JobHooks&)>;

/// Throws Interrupted if the user stopped the runs, else Error with the exit code of the first failure if a run failed.
/// `file` is the table that contains the runs' messages.
void throw_unless_complete(const JobsSummary& summary, std::size_t num_jobs, const std::filesystem::path& file);

}  // namespace gs
