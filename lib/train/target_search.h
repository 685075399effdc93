// SPDX-License-Identifier: Apache-2.0
// Searches for the smallest model that reaches a target PSNR: longer and larger trainings until the target is reached,
// then smaller models until it is lost (docs/math/optimization.md#target).
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "lib/train/training_schedule.h"

namespace gs {

/// A model with its measured quality on the held-out views.
struct MeasuredModel {
    std::int64_t steps = 0;  ///< number of steps of the run so far
    std::int64_t count = 0;
    double psnr = 0;            ///< mean PSNR of the held-out views, dB
    double standard_error = 0;  ///< standard error of `psnr`, dB
};

/// The next action of a search; its fields apply in this order.
struct TargetStep {
    bool keep = false;          ///< keep the current model for a later `restore`
    bool restore = false;       ///< go back to the last kept model
    std::int64_t prune_to = 0;  ///< number of Gaussians to keep, those with the highest scores; 0 = all
    ScheduleSegment segment;    ///< segment to train; no steps: the search has ended
};

/// The result of a search.
struct TargetOutcome {
    bool reached = false;
    double standard_error = 0;  ///< standard error of `psnr`, dB
    std::int64_t count = 0;     ///< number of Gaussians of the final model
    double psnr = 0;            ///< mean PSNR of the held-out views with the final model, dB
    double estimate = 0;        ///< estimated PSNR after all allowed steps, dB, if too low to continue; else 0
    std::int64_t measurements = 0;
    std::string verdict = {};  ///< outcome as a sentence for the log
};

/// Searches for the smallest model that reaches a PSNR. Train the segment of first(), then call next() after each
/// segment until it returns a segment without steps; outcome() then returns the result.
class TargetSearch {
  public:
    /// `target` is in dB; the run trains on `views` views, and grows for at most `most_steps` steps and to at most
    /// `cap` Gaussians.
    TargetSearch(double target, std::int64_t views, std::int64_t most_steps, std::int64_t cap);

    /// Returns the rest of the first segment for a run with `steps` finished steps and `count` Gaussians; a segment
    /// without steps if nothing is left.
    ScheduleSegment first(std::int64_t steps, std::int64_t count) const;
    /// Returns the next action after a measurement. A run resumed after the first segment begins with a measurement.
    TargetStep next(const MeasuredModel& measured);
    /// Ends an unfinished search for the reason `why`.
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
        bad_;                        ///< smallest model that reached the target; largest later one that missed it
    std::optional<double> halving_;  ///< loss of PSNR from halving the model, dB; empty until measured
    std::int64_t grown_steps_ = 0;   ///< number of steps until the target was reached
    double estimate_ = 0;            ///< TargetOutcome::estimate
    std::string why_;                ///< reason for giving the search up
};

}  // namespace gs
