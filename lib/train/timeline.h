// SPDX-License-Identifier: Apache-2.0
// Computes the position of a run between its first and its last step (docs/math/optimization.md#progress).
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "lib/core/train_options.h"

namespace gs {

/// The number of iterations of the reference training, for which all schedules are defined. Positions count in its
/// iterations, whatever the length of the run: a position is 30,000 times the progress.
inline constexpr double kReferenceIterations = 30000;

/// The state of the schedule before a step.
struct ScheduleMoment {
    std::int64_t iteration = 0;  ///< number of finished steps
    double position = 0;         ///< position of the next step, 0..30000; equals `iteration` in a run of 30,000
    double before = -1;          ///< position of the previous step; -1 before the first step
    double pace = 1;             ///< mean number of positions per step

    /// Returns the number of positions from the previous step: 1 in a run of 30,000 iterations, 4 in a run of 7,500.
    double stride() const { return position - before; }
};

/// A place in the schedule: an iteration that the user named, or a position.
class ScheduleMark {
  public:
    /// `named` is an option's value; if it is empty, the mark is at `position`.
    ScheduleMark(const std::optional<std::int64_t>& named, double position)
        : named_(named), value_(named ? double(*named) : position) {}

    bool named() const { return named_; }
    double value() const { return value_; }
    /// Return the moment, and the moment of the previous step, on the scale of the mark.
    double now(const ScheduleMoment& moment) const { return named_ ? double(moment.iteration) : moment.position; }
    double before(const ScheduleMoment& moment) const { return named_ ? double(moment.iteration - 1) : moment.before; }
    bool reached(const ScheduleMoment& moment) const { return now(moment) >= value_; }
    bool exceeded(const ScheduleMoment& moment) const { return now(moment) > value_; }

  private:
    bool named_;
    double value_;
};

/// Returns the number of multiples of `interval`, counted from `first`, in the half-open range (before, now].
inline std::int64_t multiples_passed(double before, double now, double interval, double first = 0) {
    return std::int64_t(std::floor((now - first) / interval) - std::floor((before - first) / interval));
}

/// Returns the moment after `iteration` steps of a run with options.iterations iterations.
ScheduleMoment moment_at(const ScheduleOptions& options, std::int64_t iteration);

/// Returns the moment of the next step in a run through time. `last` is the moment of the previous step, with iteration
/// 0 in a new run; `progress` (0..1) is the share of the time that has passed. The pace is copied from `last`.
ScheduleMoment next_moment(const ScheduleMoment& last, double progress);

}  // namespace gs
