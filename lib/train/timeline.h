// SPDX-License-Identifier: Apache-2.0
// Says where a run stands between its first step and its last (docs/math/optimization.md#progress).
#pragma once

#include <cmath>
#include <cstdint>
#include <optional>

#include "lib/core/train_options.h"

namespace gs {

/// The iterations of the training that every schedule is written for. A position counts in these, whatever the length
/// of the run: it is 30,000 times the progress.
inline constexpr double kReferenceIterations = 30000;

/// The moment before a step.
struct ScheduleMoment {
    std::int64_t iteration = 0;  ///< steps done
    double position = 0;         ///< of the step to come, 0..30000; in a run of 30,000 the iteration itself
    double before = -1;          ///< position of the step before it; -1 before the first
    double pace = 1;             ///< positions that a step takes on average

    /// Returns how far one step goes: 1 in a run of 30,000, 4 in one of 7,500.
    double stride() const { return position - before; }
};

/// A place in the schedule: an iteration that the user named, or else a position.
class ScheduleMark {
  public:
    /// `named` is an option's value; without one the schedule puts the place at `position`.
    ScheduleMark(const std::optional<std::int64_t>& named, double position)
        : named_(named), value_(named ? double(*named) : position) {}

    bool named() const { return named_; }
    double value() const { return value_; }
    /// Returns the moment on the scale of the mark, and that of the step before.
    double now(const ScheduleMoment& moment) const { return named_ ? double(moment.iteration) : moment.position; }
    double before(const ScheduleMoment& moment) const { return named_ ? double(moment.iteration - 1) : moment.before; }
    bool reached(const ScheduleMoment& moment) const { return now(moment) >= value_; }
    bool exceeded(const ScheduleMoment& moment) const { return now(moment) > value_; }

  private:
    bool named_;
    double value_;
};

/// Returns how many multiples of `interval`, counted from `first`, lie after `before` and not after `now`.
inline std::int64_t multiples_passed(double before, double now, double interval, double first = 0) {
    return std::int64_t(std::floor((now - first) / interval) - std::floor((before - first) / interval));
}

/// Returns the moment after `iteration` steps of a run of options.iterations.
ScheduleMoment moment_at(const ScheduleOptions& options, std::int64_t iteration);

/// Returns the moment of the next step in a run through time. `last` is that of the step before, of which 0 is the
/// iteration in a new run; `progress` (0..1) is the share of the time that has passed.
/// The pace is that of `last`.
ScheduleMoment next_moment(const ScheduleMoment& last, double progress);

}  // namespace gs
