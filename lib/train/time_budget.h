// SPDX-License-Identifier: Apache-2.0
// The time of a run with --time-limit: how much of it is left for steps, and how many Gaussians it can afford
// (docs/math/optimization.md#time).
#pragma once

#include <cstdint>

#include "kernels/base/clock.h"

namespace gs {

/// The seconds that saving takes besides what grows with the model.
inline constexpr double kSavingOverhead = 0.02;

/// What is measured before the first step.
struct TimeCosts {
    double saving_per_gaussian = 0;  ///< seconds that a Gaussian takes in the final pruning and saving
    double at_end = 0;               ///< seconds of the final pruning by score, and of measuring for a target
    double coarse_ratio = 1;         ///< time of a full image over that of a coarse one
};

class TimeBudget {
  public:
    /// `limit` is in seconds, `used` the part that was spent before a resume. `wanted_steps`: growth ends where a whole
    /// run would have fewer. `clock` gives seconds and never goes back.
    TimeBudget(double limit, double used, std::int64_t wanted_steps, double (*clock)() = seconds_now)
        : limit_(limit), used_(used), wanted_steps_(double(wanted_steps)), clock_(clock) {}

    /// The next step begins now, after `iteration` steps before a resume.
    void start(const TimeCosts& costs, std::int64_t iteration = 0);
    /// Keeps `seconds` back for what follows the steps, besides saving.
    void keep_back(double seconds) { kept_back_ = seconds; }
    /// Takes `seconds` out of the account, which went into measuring.
    void leave_out(double seconds) { start_ += seconds; }

    /// Returns the seconds since the first step, with those before a resume.
    double elapsed() const { return used_ + clock_() - start_; }
    /// Returns the seconds from the first step to the last, for a model of `count` Gaussians.
    double for_steps(std::int64_t count) const;
    double limit() const { return limit_; }
    /// Returns the share of these that has passed, 0..1.
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

}  // namespace gs
