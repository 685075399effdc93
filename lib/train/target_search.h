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

/// A model whose held-out views were measured.
struct MeasuredModel {
    std::int64_t steps = 0;  ///< of the run, up to there
    std::int64_t count = 0;
    double psnr = 0;            ///< of the held-out views, dB
    double standard_error = 0;  ///< of that mean, dB
};

/// The next move of a search, in the order of its parts.
struct TargetStep {
    bool keep = false;          ///< keep the present model, to come back to
    bool restore = false;       ///< go back to the model that was kept last
    std::int64_t prune_to = 0;  ///< remove the lowest scores until so many Gaussians are left; 0 = none
    ScheduleSegment segment;    ///< train; no steps: the search has ended
};

/// The result of a search.
struct TargetOutcome {
    bool reached = false;
    double standard_error = 0;  ///< of psnr, dB
    std::int64_t count = 0;     ///< of the model that the run ends with
    double psnr = 0;            ///< of the held-out views with it, dB
    double estimate = 0;        ///< PSNR that all steps would have reached, where that was too little, dB; else 0
    std::int64_t measurements = 0;
    std::string verdict = {};  ///< a sentence for people
};

/// Searches for the smallest model that reaches a PSNR. The segment of first() is trained first; then next() follows
/// each segment until it returns one without steps; then outcome() tells the result.
class TargetSearch {
  public:
    /// `target` is in dB; the run trains on `views` views and has `most_steps` at most while it grows, and `cap`
    /// Gaussians.
    TargetSearch(double target, std::int64_t views, std::int64_t most_steps, std::int64_t cap);

    /// Returns what is left of the first segment of a run that has done `steps` and has `count` Gaussians; no steps if
    /// nothing is.
    ScheduleSegment first(std::int64_t steps, std::int64_t count) const;
    /// Decides what follows from a measurement. A run that was resumed after the first segment begins with one.
    TargetStep next(const MeasuredModel& measured);
    /// Ends a search that could have gone on, for the reason `why`.
    void stop(const std::string& why) { why_ = why; }

    TargetOutcome outcome() const;

  private:
    TargetStep grow(const MeasuredModel& measured);
    TargetStep shrink(const MeasuredModel& measured);
    std::int64_t most_gaussians(std::int64_t steps, std::int64_t count) const;

    const double target_;
    const std::int64_t most_steps_, first_steps_, cap_;
    std::vector<MeasuredModel> tries_;
    std::optional<MeasuredModel> good_,
        bad_;                        ///< the smallest that reached the target, the largest after it that did not
    std::optional<double> halving_;  ///< loss of PSNR by halving the model, dB, once that is known
    std::int64_t grown_steps_ = 0;   ///< steps until the target was reached
    double estimate_ = 0;            ///< TargetOutcome::estimate
    std::string why_;                ///< why the search was given up
};

}  // namespace gs
