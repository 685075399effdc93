// SPDX-License-Identifier: Apache-2.0
// Leads a run to a PSNR: longer and larger trainings until it is reached, then smaller models until it would be lost
// (docs/math/optimization.md#target).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lib/train/training_schedule.h"

namespace gs {

/// What follows a measurement of the held-out views.
struct TargetStep {
    bool restore = false;       ///< first goes back to the model that was kept last
    bool keep = false;          ///< keeps the present model, to come back to
    std::int64_t prune_to = 0;  ///< then removes the lowest scores until so many Gaussians are left; 0 = none
    ScheduleSegment segment;    ///< then trains; no steps: the search has ended
};

/// What came of a search.
struct TargetOutcome {
    bool reached = false;
    double standard_error = 0;  ///< of psnr, dB
    std::int64_t count = 0;     ///< of the model that the run ends with
    double psnr = 0;            ///< of the held-out views with it, dB
    double estimate = 0;        ///< what all steps would have reached, where that was too little, dB; else 0
    std::int64_t measurements = 0;
    std::string verdict = {};  ///< a sentence for people
};

class TargetSearch {
  public:
    /// A model that was measured.
    struct Try {
        std::int64_t steps = 0;  ///< of the run, up to there
        std::int64_t count = 0;
        double psnr = 0;            ///< of the held-out views, dB
        double standard_error = 0;  ///< of that mean, dB
    };

    /// `target` is in dB; the run trains on `views` views and has `most_steps` at most while it grows, and `cap`
    /// Gaussians.
    TargetSearch(double target, std::int64_t views, std::int64_t most_steps, std::int64_t cap);

    /// Returns what is left of the first segment of a run that has done `steps` and has `count` Gaussians; no steps if
    /// nothing is.
    ScheduleSegment first(std::int64_t steps, std::int64_t count) const;
    /// Decides what follows from a measurement. A run that was resumed after the first segment begins with one.
    TargetStep next(const Try& measured);
    /// Says why a search ends here that could have gone on.
    void stop(const std::string& why) { why_ = why; }

    TargetOutcome outcome() const;

  private:
    TargetStep grow(const Try& measured);
    TargetStep shrink(const Try& measured);
    std::int64_t most_gaussians(std::int64_t steps, std::int64_t count) const;

    const double target_;
    const std::int64_t most_steps_, first_steps_, cap_;
    std::vector<Try> tries_;
    std::optional<Try> good_, bad_;  ///< the smallest that reached the target, the largest after it that did not
    std::optional<double> halving_;  ///< what halving the model costs, dB, once that is known
    std::int64_t grown_steps_ = 0;   ///< until the target was reached
    double estimate_ = 0;            ///< TargetOutcome::estimate
    std::string why_;                ///< why it was given up
};

}  // namespace gs
