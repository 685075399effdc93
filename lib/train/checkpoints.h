// SPDX-License-Identifier: Apache-2.0
// Schedules and writes the checkpoints of a run, and saves a run that fails.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/run_writer.h"
#include "lib/train/training_clock.h"
#include "lib/train/training_schedule.h"

namespace gs {

/// Writes the checkpoints of a run: checkpoints at the iterations that the options list, one every few minutes, one for
/// each request of a watcher, and one when an error ends the run. All references must outlive the object. A resumed run
/// creates the object after resuming.
class Checkpoints {
  public:
    Checkpoints(const OutputOptions& options, const TrainingSchedule& schedule, const TrainingClock& clock,
                CameraRefinement& cameras, const RunWriter& writer);

    /// Writes a checkpoint of the current iteration. Throws DataError.
    void write(Backend& backend);
    /// Writes a checkpoint if options.checkpoint_minutes of training have passed since the last checkpoint. Its timing
    /// must not change the course of the training, so the checkpoint is written only right after the scan for
    /// non-finite parameters: the scan brings all rows on the device up to date, as reading them would. A failure to
    /// write is only a warning.
    void write_by_time(Backend& backend);
    /// Writes a checkpoint and the point cloud. Returns the error message, which is also logged as a warning; empty on
    /// success.
    std::string write_with_points(Backend& backend);
    /// Saves the model after an error, in its state after the last finished step. Saves nothing if this process
    /// finished no step or the model cannot be read from the device any more. Up to three steps that a failed device
    /// had not finished are missing. Returns the text to append to the error message.
    std::string rescue(Backend& backend);

    /// Stores `model` instead of the current model in all later checkpoints; empty: the current model again. The search
    /// for a target keeps the smallest model that reached the target. Otherwise a run resumed with a smaller model that
    /// is still recovering would take that model to be below the target.
    void keep(std::optional<Gaussians> model) { kept_ = std::move(model); }
    const std::optional<Gaussians>& kept() const { return kept_; }

    /// Returns the command that continues the run, phrased as part of a sentence.
    std::string how_to_continue() const;

  private:
    void write(Backend& backend, bool automatic);
    std::string latest() const;

    const OutputOptions& options_;
    const TrainingSchedule& schedule_;
    const TrainingClock& clock_;
    CameraRefinement& cameras_;
    const RunWriter& writer_;
    const std::int64_t first_iteration_;  ///< iteration at which this process began
    std::optional<Gaussians> kept_;
    double written_at_;          ///< training time at the last checkpoint, in seconds
    bool cost_is_told_ = false;  ///< whether the cost of a timed checkpoint was logged
};

}  // namespace gs
