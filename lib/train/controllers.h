// SPDX-License-Identifier: Apache-2.0
// Trains the PPISP controllers, which correct views that the training did not use (docs/math/ppisp.md).
#pragma once

#include <cstdint>
#include <optional>

#include "kernels/ranks/backend.h"
#include "lib/core/progress.h"
#include "lib/train/step_monitor.h"
#include "lib/train/step_runner.h"
#include "lib/train/train_hooks.h"
#include "lib/train/training_schedule.h"

namespace gs {

struct ControllerTraining {
    std::int64_t iterations = 0;
    bool stopped = false;  ///< true if Ctrl-C or a watcher stopped it; the controllers are then lost
};

/// Adds controllers to the model and trains them after the last change of the Gaussians, which stay as they are. Trains
/// for `iterations`, or if that is empty until the time limit ends. Checkpoints do not contain the controllers: a
/// resumed run trains them from the start. Throws what StepMonitor::read throws.
ControllerTraining train_controllers(Backend& backend, const std::optional<std::int64_t>& iterations,
                                     const TrainingSchedule& schedule, StepRunner& steps, StepMonitor& monitor,
                                     const Watcher& watcher, Progress& progress);

}  // namespace gs
