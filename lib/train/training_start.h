// SPDX-License-Identifier: Apache-2.0
// Uploads the initial or resumed model of a training to its device.
#pragma once

#include <memory>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/model_limits.h"
#include "lib/train/run_start.h"
#include "lib/train/run_writer.h"
#include "lib/train/step_runner.h"
#include "lib/train/train_hooks.h"
#include "lib/train/training_clock.h"
#include "lib/train/training_schedule.h"

namespace gs {

/// Makes the backend of a training, sets schedule, steps and clock to the start of the training, and writes the first
/// files. The object is used once; all references must outlive it.
class TrainingStart {
  public:
    TrainingStart(const TrainOptions& options, const Scene& scene, const TrainHooks& hooks, const ModelLimits& limits,
                  TrainingSchedule& schedule, StepRunner& steps, TrainingClock& clock, const RunWriter& writer)
        : options_(options),
          scene_(scene),
          hooks_(hooks),
          limits_(limits),
          schedule_(schedule),
          steps_(steps),
          clock_(clock),
          writer_(writer) {}

    /// Returns the backend with the model of start.checkpoint, else of start.initial, else with a model made from
    /// points. Moves the model out of `start`. Throws UsageError for limits that cannot be met, and what the parts
    /// throw.
    std::unique_ptr<Backend> make(RunStart& start);

  private:
    std::unique_ptr<Backend> begin(RunStart& start);
    std::unique_ptr<Backend> resume(Checkpoint& checkpoint);
    std::unique_ptr<Backend> empty_backend();
    std::int64_t affordable_points(Backend& backend, const Gaussians& all) const;

    const TrainOptions& options_;
    const Scene& scene_;
    const TrainHooks& hooks_;
    const ModelLimits& limits_;
    TrainingSchedule& schedule_;
    StepRunner& steps_;
    TrainingClock& clock_;
    const RunWriter& writer_;
};

}  // namespace gs
