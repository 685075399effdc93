// SPDX-License-Identifier: Apache-2.0
// Leads a run from its first step to its last: through a number of iterations, through a length of time, or through
// segments that are decided one after another.
#pragma once

#include <cstdint>
#include <optional>

#include "kernels/base/clock.h"
#include "lib/train/timeline.h"

namespace gs {

// The time of a run with --time-limit: how much of it is left for steps, and how many Gaussians it can afford
// (docs/math/optimization.md#time).

/// The seconds that saving takes besides what grows with the model.
inline constexpr double kSavingOverhead = 0.02;

/// The times that are measured before the first step.
struct TimeCosts {
    double saving_per_gaussian = 0;  ///< seconds that a Gaussian takes in the final pruning and saving
    double at_end = 0;               ///< seconds of the final pruning by score, and of measuring for a target
    double coarse_ratio = 1;         ///< time of a full image over that of a coarse one
};

/// Divides a time limit. start() comes first; then keep_back() and leave_out() change what is left.
class TimeBudget {
  public:
    /// `limit` is in seconds, `used` the part that was spent before a resume. Growth ends where a whole run would have
    /// fewer than `wanted_steps`. `clock` gives seconds and never goes back.
    TimeBudget(double limit, double used, std::int64_t wanted_steps, double (*clock)() = seconds_now)
        : limit_(limit), used_(used), wanted_steps_(double(wanted_steps)), clock_(clock) {}

    /// Begins to count the time. The next step follows, after `iteration` steps before a resume.
    void start(const TimeCosts& costs, std::int64_t iteration = 0);
    /// Keeps `seconds` back for the work that follows the steps, besides saving.
    void keep_back(double seconds) { kept_back_ = seconds; }
    /// Does not count `seconds` that have just passed.
    void leave_out(double seconds) { start_ += seconds; }

    /// Returns the seconds since the first step, with those before a resume.
    double elapsed() const { return used_ + clock_() - start_; }
    /// Returns the seconds from the first step to the last, for a model of `count` Gaussians.
    double for_steps(std::int64_t count) const;
    double limit() const { return limit_; }
    /// Returns the share of for_steps(count) that has passed, 0..1.
    double progress(std::int64_t count) const;

    /// Returns the number of Gaussians with which enough steps would follow, judged by the time of the steps since the
    /// last call; `count` if there were too few to tell. Steps are on coarse images while `coarse`.
    std::int64_t affordable(std::int64_t count, std::int64_t iteration, bool coarse);

  private:
    double limit_, used_, wanted_steps_;
    double (*clock_)();
    double start_ = 0, kept_back_ = 0;
    TimeCosts costs_;
    double marked_seconds_ = 0;  ///< elapsed() at the last call of affordable
    std::int64_t marked_iteration_ = 0;
};

/// A part of a run whose schedules go from some position to the end.
struct ScheduleSegment {
    std::int64_t steps = 0;
    double from = 0;                  ///< position of its first step
    std::int64_t most_gaussians = 0;  ///< the largest number that growth may lead to
};

/// Returns the number of steps below which a time limit does not let the model grow: 70 rounds through the views, at
/// most 20,000 steps.
std::int64_t wanted_steps(std::size_t num_views);

/// Leads a run from its first step to its last. A resumed run calls resume() first, and a run with a time limit start()
/// before its first step. A search for a target calls begin() before each of its segments. advance() follows every
/// step.
class TrainingSchedule {
  public:
    TrainingSchedule(const ScheduleOptions& options, std::size_t num_views);

    /// Continues after `iteration` steps, which took `used` seconds of a time limit.
    void resume(std::int64_t iteration, double used);
    /// Takes the seconds that went by before the first step of a new run from a time limit, if there is one. Progress
    /// does not count them.
    void charge(double seconds) {
        if (!limits_time()) return;
        limit_ -= seconds;
        charged_ += seconds;
    }
    /// Returns the seconds of the time limit that have passed; 0 without one.
    double used_seconds() const { return budget_ ? charged_ + budget_->elapsed() : 0; }
    bool limits_time() const { return limit_ > 0; }
    /// Returns the number of Gaussians with which a time limit leaves enough steps, where a frame of `count` takes
    /// `frame_seconds`.
    std::int64_t affordable_start(std::int64_t count, double frame_seconds) const;
    /// Begins to count the time of a run with a limit; the first step follows. Throws UsageError if saving alone would
    /// take longer than is left.
    void start(const TimeCosts& costs, std::int64_t count);
    /// Goes on with a segment. A time limit shortens it, and the schedules with it, to what is left for a model of
    /// `count` Gaussians.
    void begin(const ScheduleSegment& segment, std::int64_t count);

    const ScheduleMoment& moment() const { return moment_; }
    /// Returns the number of finished iterations.
    std::int64_t iteration() const { return moment_.iteration; }
    bool finished() const { return finished_; }
    /// Goes on after a step on `views` views, with `count` Gaussians. Each view is an iteration.
    void advance(std::int64_t count, std::int64_t views = 1);
    /// Returns the number of iterations of the run, or to the end of the segment; 0 while time decides.
    std::int64_t expected_iterations() const;
    /// Returns the seconds of the time limit that are left, also for what follows the steps; empty without a limit.
    std::optional<double> seconds_left() const;

    /// Returns how many times images are reduced in the next step.
    int reduction() const;
    /// Returns the largest number of Gaussians that the next step may have: `cap`, or what the time affords.
    std::int64_t most_gaussians(std::int64_t count, std::int64_t cap);

    /// Keeps a share of a time limit for training the PPISP controllers: the time of `iterations` steps, or without a
    /// number as much of the whole as they have in a run of iterations.
    void keep_back_for_controllers(const std::optional<std::int64_t>& iterations);
    /// Does not count `seconds` that have just passed towards a time limit.
    void leave_out(double seconds) {
        if (budget_) budget_->leave_out(seconds);
    }

    std::int64_t wanted_steps() const { return wanted_steps_; }
    /// Returns the division of the time; empty without a limit, or before start().
    const std::optional<TimeBudget>& budget() const { return budget_; }

  private:
    void advance_one(std::int64_t count);
    bool ends_here() const;
    void advance_segment(std::int64_t count);

    const ScheduleOptions options_;
    double limit_;  ///< seconds; 0 = none
    const std::int64_t wanted_steps_;
    double charged_ = 0, used_ = 0;
    std::optional<TimeBudget> budget_;
    std::int64_t first_iteration_ = 0;  ///< steps before start()
    double warm_position_ = 0;          ///< after the first steps under a time limit
    std::optional<ScheduleSegment> segment_;
    std::int64_t segment_iteration_ = 0;  ///< steps before the segment
    double segment_start_ = 0;            ///< seconds of the time limit before it
    ScheduleMoment moment_;
    bool finished_ = false;
};

}  // namespace gs
