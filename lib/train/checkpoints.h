// SPDX-License-Identifier: Apache-2.0
// Decides when a training writes checkpoints and what they hold, and saves a run that fails.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/train/run_writer.h"
#include "lib/train/training_clock.h"
#include "lib/train/training_schedule.h"

namespace gs {

/// Writes the checkpoints of a run: those that options list, one every few minutes, those that a watcher asks for, and
/// one when an error ends the run. All references must outlive the object, which is made when the run has been resumed.
class Checkpoints {
  public:
    Checkpoints(const OutputOptions& options, const TrainingSchedule& schedule, const TrainingClock& clock,
                const RunWriter& writer);

    /// Writes a checkpoint of the present iteration. Throws DataError.
    void write(Backend& backend);
    /// Writes a checkpoint if options.checkpoint_minutes of training have passed since the last one. The course of the
    /// training must not depend on that: it happens only where the scan for non-finite parameters has just brought all
    /// rows of the device up to date, which reading them would do, too. A failure to write is only a warning.
    void write_by_time(Backend& backend);
    /// Writes a checkpoint and the point cloud. Returns what went wrong, of which it also warns; empty if nothing did.
    std::string write_with_points(Backend& backend);
    /// Saves the model after an error, as the last finished step left it, if this process finished a step and the
    /// device still gives the model out. Up to three steps that a failed device had not finished are missing. Returns
    /// what the message of the error should add.
    std::string rescue(Backend& backend);

    /// Puts a model in the place of the present one in all checkpoints from now on; empty: the present one again. The
    /// search for a target keeps the smallest model that reached it, since a run that was resumed with a smaller one
    /// that is still recovering would take that to be below the target.
    void keep(std::optional<Gaussians> model) { kept_ = std::move(model); }
    const std::optional<Gaussians>& kept() const { return kept_; }

    /// Returns the command that continues the run, as part of a sentence.
    std::string how_to_continue() const;

  private:
    void write(Backend& backend, bool automatic);
    std::string latest() const;

    const OutputOptions& options_;
    const TrainingSchedule& schedule_;
    const TrainingClock& clock_;
    const RunWriter& writer_;
    const std::int64_t first_iteration_;  ///< where this process began
    std::optional<Gaussians> kept_;
    double written_at_;          ///< seconds of training at the last checkpoint
    bool cost_is_told_ = false;  ///< of one by time
};

}  // namespace gs
