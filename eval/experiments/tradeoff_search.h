// SPDX-License-Identifier: Apache-2.0
// Trains the configurations of a trade-off, round by round, within a time limit, judging how long they will take by
// those that have ended.
#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include "eval/experiments/job_runner.h"
#include "eval/experiments/tradeoff_plan.h"
#include "lib/core/train_options.h"

namespace gs {

/// How long trainings will take, judged by those that have ended.
class TimePlan {
  public:
    /// A training that has ended. `wall_seconds`: with loading and scoring; empty if nobody measured it.
    void add(const TrainOptions& options, double train_seconds, std::optional<double> wall_seconds);

    /// The expected time from start to scores, s: the time limit, where the options have one, else that of the ended
    /// run which is nearest in iterations and --cap-max (and of this appearance where two are equally near), its
    /// training in proportion to iterations and to --cap-max. That is too much for a larger run, whose iterations do
    /// not all have the full number of Gaussians, so it errs on the safe side. Empty while no run has ended.
    std::optional<double> seconds(const TrainOptions& options) const;

    /// Whether it is expected to end in that time; without any measurement yet it is worth a try.
    bool fits(const TrainOptions& options, double seconds_left) const {
        return seconds(options).value_or(0) <= seconds_left;
    }

  private:
    struct Ended {
        TrainOptions options;
        double train_seconds;
    };
    std::vector<Ended> ended_;
    double overhead_seconds_ = 0;  ///< the most that a run took besides its training
};

/// Trains the rounds of `plan` and fills `plan.tradeoff.runs`; writes the trade-off to its folder after every run. A
/// round after the first trains the better half of the one before (`promoted`), provided that this one is complete but
/// for failures. With a deadline nothing is started that TimePlan expects to end after it. Throws what write_tradeoff
/// and `run` throw. Call catch_interrupts() before.
JobsSummary search_tradeoff(TradeoffPlan& plan, std::optional<std::chrono::steady_clock::time_point> deadline,
                            const JobsRunner& run = run_jobs);

}  // namespace gs
