// SPDX-License-Identifier: Apache-2.0
// Trains the PPISP controllers, which correct views that were not trained on (docs/math/ppisp.md).
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
    bool stopped = false;  ///< by Ctrl-C or by whoever watches; the controllers are then lost
};

/// Adds controllers to the model and trains them, after the last change of the Gaussians, which stay as they are. It
/// takes `iterations`, or without a number what is left of the time limit. No checkpoint holds the controllers: if the
/// training is stopped, it begins anew in the resumed run. Throws what StepMonitor::read throws.
ControllerTraining train_controllers(Backend& backend, const std::optional<std::int64_t>& iterations,
                                     const TrainingSchedule& schedule, StepRunner& steps, StepMonitor& monitor,
                                     const Watcher& watcher, Progress& progress);

}  // namespace gs
