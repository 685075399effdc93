// SPDX-License-Identifier: Apache-2.0
// Trains the configurations of a trade-off, round by round, within a time limit, predicting training times from
// finished runs.
#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include "eval/experiments/job_runner.h"
#include "eval/experiments/tradeoff_plan.h"
#include "lib/core/train_options.h"

namespace gs {

/// Predicts how long trainings take from those that have ended.
class TimePlan {
  public:
    /// Adds a training that has ended. `wall_seconds`: time including loading and scoring; empty if not measured.
    void add(const TrainOptions& options, double train_seconds, std::optional<double> wall_seconds);

    /// Returns the expected time from start to scores, s: the largest overhead so far plus the training time. The
    /// training time is the time limit if the options have one, else that of the ended run nearest in iterations and
    /// --cap-max (if two are equally near, the one with the same appearance), scaled in proportion to iterations and
    /// --cap-max. This overestimates larger runs, whose iterations do not all have the full number of Gaussians, and so
    /// errs on the safe side. Only runs that end by their iterations count. Empty if there is no such run
    /// and no time limit.
    std::optional<double> seconds(const TrainOptions& options) const;

    /// Returns whether the training is expected to end in that time; true if there is no measurement yet.
    bool fits(const TrainOptions& options, double seconds_left) const {
        return seconds(options).value_or(0) <= seconds_left;
    }

  private:
    struct Ended {
        TrainOptions options;
        double train_seconds;
    };
    std::vector<Ended> ended_;
    double overhead_seconds_ = 0;  ///< longest time of a run besides its training
};

/// Trains the rounds of `plan` and fills `plan.tradeoff.runs`; writes the trade-off to its folder after every run. A
/// later round trains the better half of the previous round (`promoted`), provided that the previous round is complete
/// except for failures. With a deadline, starts no job that TimePlan expects to end after it. Throws the errors of
/// write_tradeoff and `run`. Call catch_interrupts() before.
JobsSummary search_tradeoff(TradeoffPlan& plan, std::optional<std::chrono::steady_clock::time_point> deadline,
                            const JobsRunner& run = run_jobs);

}  // namespace gs
