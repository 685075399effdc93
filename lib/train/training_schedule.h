// SPDX-License-Identifier: Apache-2.0
// Schedules a run from its first step to its last: by a number of iterations, by a time limit, or by segments that are
// decided one after another.
#pragma once

#include <cstdint>
#include <optional>

#include "kernels/base/clock.h"
#include "lib/train/timeline.h"

namespace gs {

// Division of the time of a run with --time-limit: the time left for steps, and the affordable number of Gaussians
// (docs/math/optimization.md#time).

/// The part of the saving time that does not depend on the size of the model, in seconds.
inline constexpr double kSavingOverhead = 0.02;

/// The costs that are measured before the first step.
struct TimeCosts {
    double saving_per_gaussian = 0;  ///< time of saving, in seconds per Gaussian
    double at_end = 0;               ///< time of the final pruning by score and of measuring for a target, in seconds
    double coarse_ratio = 1;         ///< ratio of the render time of a full image to that of a coarse image
};

/// Divides a time limit. Call start() first; then keep_back() and leave_out() change the time left for steps.
class TimeBudget {
  public:
    /// `limit` is in seconds, `used` is the part spent before a resume. Growth ends when a whole run would have fewer
    /// than `wanted_steps` steps. `clock` gives seconds and never goes back.
    TimeBudget(double limit, double used, std::int64_t wanted_steps, double (*clock)() = seconds_now)
        : limit_(limit), used_(used), wanted_steps_(double(wanted_steps)), clock_(clock) {}

    /// Starts the clock directly before the next step. `iteration` is the number of steps before a resume.
    void start(const TimeCosts& costs, std::int64_t iteration = 0);
    /// Reserves `seconds` for the work after the steps, in addition to saving.
    void keep_back(double seconds) { kept_back_ = seconds; }
    /// Excludes `seconds` that have just passed.
    void leave_out(double seconds) { start_ += seconds; }

    /// Returns the time since the first step in seconds, including the time before a resume.
    double elapsed() const { return used_ + clock_() - start_; }
    /// Returns the time available for all steps, in seconds, for a model of `count` Gaussians.
    double for_steps(std::int64_t count) const;
    double limit() const { return limit_; }
    /// Returns the share of for_steps(count) that has passed, 0..1.
    double progress(std::int64_t count) const;

    /// Returns the number of Gaussians that leaves time for enough steps, judged by the time of the steps since the
    /// last call; `count` if these steps were too few. `coarse` means that they used coarse images.
    std::int64_t affordable(std::int64_t count, std::int64_t iteration, bool coarse);

  private:
    double limit_, used_, wanted_steps_;
    double (*clock_)();
    double start_ = 0, kept_back_ = 0;
    TimeCosts costs_;
    double marked_seconds_ = 0;  ///< elapsed() at the last call of affordable() that measured
    std::int64_t marked_iteration_ = 0;
};

/// A part of a run whose schedules go from a given position to the end.
struct ScheduleSegment {
    std::int64_t steps = 0;
    double from = 0;                  ///< position of its first step
    std::int64_t most_gaussians = 0;  ///< largest number of Gaussians that growth may reach
};

/// Returns the number of steps below which a time limit stops the growth of the model: 70 rounds through the views, at
/// most 20,000 steps.
std::int64_t wanted_steps(std::size_t num_views);

/// Schedules a run from its first step to its last. A resumed run calls resume() first, and a run with a time limit
/// calls start() before its first step. A search for a target calls begin() before each of its segments. Call advance()
/// after every step.
class TrainingSchedule {
  public:
    TrainingSchedule(const ScheduleOptions& options, std::size_t num_views);

    /// Continues after `iteration` steps, which took `used` seconds of a time limit.
    void resume(std::int64_t iteration, double used);
    /// Subtracts seconds that passed before the first step of a new run from the time limit, if there is one. Progress
    /// does not count these seconds.
    void charge(double seconds) {
        if (!limits_time()) return;
        limit_ -= seconds;
        charged_ += seconds;
    }
    /// Returns the used part of the time limit in seconds; 0 without a limit.
    double used_seconds() const { return budget_ ? charged_ + budget_->elapsed() : 0; }
    bool limits_time() const { return limit_ > 0; }
    /// Returns the initial number of Gaussians, at most `count`, that leaves time for enough steps, if a frame of
    /// `count` Gaussians takes `frame_seconds`.
    std::int64_t affordable_start(std::int64_t count, double frame_seconds) const;
    /// Starts the clock of a run with a time limit, directly before its first step. Throws UsageError if the limit of a
    /// new run is too short for saving.
    void start(const TimeCosts& costs, std::int64_t count);
    /// Begins a segment. A time limit shortens the segment and its schedules to the time left for a model of `count`
    /// Gaussians.
    void begin(const ScheduleSegment& segment, std::int64_t count);

    const ScheduleMoment& moment() const { return moment_; }
    /// Returns the number of finished iterations.
    std::int64_t iteration() const { return moment_.iteration; }
    bool finished() const { return finished_; }
    /// Advances after a step on `views` views, with `count` Gaussians. Each view counts as an iteration.
    void advance(std::int64_t count, std::int64_t views = 1);
    /// Returns the number of iterations at the end of the run or segment; 0 while a time limit decides.
    std::int64_t expected_iterations() const;
    /// Returns the rest of the time limit in seconds, including the time for the work after the steps; empty without a
    /// limit.
    std::optional<double> seconds_left() const;

    /// Returns the reduction factor of images in the next step.
    int reduction() const;
    /// Returns the largest number of Gaussians in the next step: `cap`, or less if the time or the segment requires it,
    /// but no less than the current `count` up to `cap`.
    std::int64_t most_gaussians(std::int64_t count, std::int64_t cap);

    /// Reserves part of a time limit for training the PPISP controllers: the time of `iterations` steps, or if that is
    /// empty the same share as in a run that ends by iterations.
    void keep_back_for_controllers(const std::optional<std::int64_t>& iterations);
    /// Excludes `seconds` that have just passed from a time limit.
    void leave_out(double seconds) {
        if (budget_) budget_->leave_out(seconds);
    }

    std::int64_t wanted_steps() const { return wanted_steps_; }
    /// Returns the time budget; empty without a limit, or before start().
    const std::optional<TimeBudget>& budget() const { return budget_; }

  private:
    void advance_one(std::int64_t count);
    bool ends_here() const;
    void advance_segment(std::int64_t count);

    const ScheduleOptions options_;
    double limit_;  ///< time limit in seconds; 0 = none
    const std::int64_t wanted_steps_;
    double charged_ = 0, used_ = 0;
    std::optional<TimeBudget> budget_;
    std::int64_t first_iteration_ = 0;  ///< number of steps before start()
    double warm_position_ = 0;          ///< position after the warm-up steps under a time limit
    std::optional<ScheduleSegment> segment_;
    std::int64_t segment_iteration_ = 0;  ///< number of steps before the segment
    double segment_start_ = 0;            ///< used seconds of the time limit at the start of the segment
    ScheduleMoment moment_;
    bool finished_ = false;
};

}  // namespace gs
