// SPDX-License-Identifier: Apache-2.0
// Reads the statistics of a training's steps, and keeps the model finite.
#pragma once

#include <cstdint>

#include "kernels/ranks/backend.h"
#include "lib/train/journal.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {

/// The number of iterations between two reads of the steps' statistics; a read after every step would make the device
/// wait. Also the number of consecutive non-finite losses after which a training does not recover.
inline constexpr std::int64_t kStatsInterval = 10;

/// Monitors losses and gradients, and ends a training whose values do not stay finite. All references must outlive the
/// object.
class StepMonitor {
  public:
    StepMonitor(const TrainingSchedule& schedule, TrainingViews& views, Journal& journal)
        : schedule_(schedule), views_(views), journal_(journal) {}

    /// Reads the statistics of the finished steps without waiting for others. Throws NumericError if the loss was not
    /// finite kStatsInterval times in a row.
    void read(Backend& backend);
    /// Waits until all steps are done, and reads their statistics.
    void settle(Backend& backend) {
        backend.synchronize();
        read(backend);
    }
    /// Returns the most recently read statistics.
    const StepStats& last() const { return last_; }

    /// Removes Gaussians with parameters that are not finite or out of range. Throws NumericError if none is left.
    void prune_nonfinite(Backend& backend);

    /// Logs warnings with the numbers of gradients skipped and Gaussians removed during the run.
    void report() const;

  private:
    const TrainingSchedule& schedule_;
    TrainingViews& views_;
    Journal& journal_;
    StepStats last_;
    std::int64_t skipped_gradients_ = 0, removed_gaussians_ = 0;
};

}  // namespace gs
