// SPDX-License-Identifier: Apache-2.0
// Reads what the steps of a training report, and keeps the model finite.
#pragma once

#include <cstdint>

#include "kernels/ranks/backend.h"
#include "lib/train/journal.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {

/// The iterations between two looks at the statistics of steps, since asking a device each time would make it wait. A
/// loss that is not finite this often in a row does not recover.
inline constexpr std::int64_t kStatsInterval = 10;

/// Follows losses and gradients, and ends a training whose numbers do not stay finite. All references must outlive the
/// object.
class StepMonitor {
  public:
    StepMonitor(const TrainingSchedule& schedule, TrainingViews& views, Journal& journal)
        : schedule_(schedule), views_(views), journal_(journal) {}

    /// Reads the statistics of the steps that are known to be done, without waiting. Throws NumericError when the loss
    /// was not finite kStatsInterval times in a row.
    void read(Backend& backend);
    /// Waits until all steps are done, and reads their statistics.
    void settle(Backend& backend) {
        backend.synchronize();
        read(backend);
    }
    /// Returns the statistics that were read last.
    const StepStats& last() const { return last_; }

    /// Removes Gaussians with parameters that are not finite or out of range. Throws NumericError when none is left.
    void prune_nonfinite(Backend& backend);

    /// Warns of everything that was skipped or removed during the run.
    void report() const;

  private:
    const TrainingSchedule& schedule_;
    TrainingViews& views_;
    Journal& journal_;
    StepStats last_;
    std::int64_t skipped_gradients_ = 0, removed_gaussians_ = 0;
};

}  // namespace gs
