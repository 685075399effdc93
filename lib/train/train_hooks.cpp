// SPDX-License-Identifier: Apache-2.0
// Reports the state of a training to its watcher.
#include "lib/train/train_hooks.h"

#include "lib/train/step_monitor.h"
#include "lib/train/training_clock.h"
#include "lib/train/training_schedule.h"

namespace gs {

WatcherRequest Watcher::ask(Backend& backend, bool rows_current) const {
    WatcherRequest request = WatcherRequest::kNone;
    if (!hooks_.between) return request;
    clock_.leave_out([&] {
        request = hooks_.between({.iteration = schedule_.iteration(),
                                  .num_gaussians = backend.count(),
                                  .expected_iterations = schedule_.expected_iterations(),
                                  .seconds_left = schedule_.seconds_left(),
                                  .loss = monitor_.last().loss,
                                  .train_seconds = clock_.train_seconds(),
                                  .rows_current = rows_current},
                                 backend);
    });
    return request;
}

}  // namespace gs
