// SPDX-License-Identifier: Apache-2.0
// Trains many runs as processes of this program, one after another or one on each GPU, and keeps those that are
// finished. Several callers with the same jobs, on any machines that share the folders, divide them among themselves,
// and each is told the results of all.
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

/// How one job ended: with a result, with an error, or with neither when the user or the deadline stopped it.
struct JobOutcome {
    std::optional<RunResult> result = {};
    std::string error = {};
    ExitCode code = ExitCode::kOk;
    /// Seconds from start to end of the process; empty if this call did not train the job.
    std::optional<double> wall_seconds = {};
};

/// How the caller takes part. The calls never overlap.
struct JobHooks {
    /// Is told of every job that has ended, and first of those that were finished before. An exception stops
    /// everything and leaves run_jobs.
    std::function<void(std::size_t job, const JobOutcome&)> done;
    /// Picks the job to train next out of the pending ones that no other process works on, which come in their order;
    /// nothing = none of them now.
    /// Without it the first is next.
    std::function<std::optional<std::size_t>(const std::vector<std::size_t>& pending)> choose = {};
    /// The time at which runs under way are stopped and from which none is started.
    std::optional<std::chrono::steady_clock::time_point> deadline = {};
    /// The program that trains, called as `program train --config FILE --time-frames N [--overwrite]`; empty: this
    /// program.
    std::filesystem::path program = {};
    /// A process that works on a job and gives no sign of life for this long is taken for dead.
    std::chrono::milliseconds stale_after = std::chrono::seconds(60);
};

/// What became of all jobs together.
struct JobsSummary {
    int num_failed = 0;
    ExitCode first_code = ExitCode::kOk;  ///< exit code of the first failure
    bool interrupted = false;             ///< the user stopped the runs before all were trained
};

/// Trains the jobs whose folders do not hold them yet, or all of them with the option `overwrite`. All jobs go to the
/// same device. A job that another process works on is waited for, and taken over if that process is gone. A run that
/// fails does not stop the others, and the processes that are at work then do not try it again; later ones do. Once
/// interrupted() is true nothing more is started, and runs under way write their checkpoint and end. Jobs that were
/// not reached are not `done`. Call catch_interrupts() before. Throws DeviceError for a device that is not there.
JobsSummary run_jobs(const std::vector<Job>& jobs, const JobHooks& hooks);

/// What trains jobs: run_jobs, or what a test puts in its place.
using JobsRunner = std::function<JobsSummary(const std::vector<Job>&, const JobHooks&)>;

/// Throws Interrupted if the user stopped the runs, else Error with the exit code of the first failure if a run failed.
/// `file` is the table that has the runs' messages.
void throw_unless_complete(const JobsSummary& summary, std::size_t num_jobs, const std::filesystem::path& file);

}  // namespace gs
