// SPDX-License-Identifier: Apache-2.0
// Runs the controllers' steps until their number or the time is used up.
#include "lib/train/controllers.h"

#include "lib/core/interrupt.h"

namespace gs {
namespace {

/// The part of a time limit reserved for finishing and writing the controllers, in seconds.
constexpr double kEnd = 0.05;

}  // namespace

ControllerTraining train_controllers(Backend& backend, const std::optional<std::int64_t>& iterations,
                                     const TrainingSchedule& schedule, StepRunner& steps, StepMonitor& monitor,
                                     const Watcher& watcher, Progress& progress) {
    const auto seconds_left = [&] {
        const std::optional<double> left = schedule.seconds_left();
        return left ? std::optional(*left - kEnd) : std::nullopt;
    };
    const auto is_done = [&](std::int64_t k) {
        if (iterations && k >= *iterations) return true;
        return k > 0 && seconds_left() && *seconds_left() <= 0;
    };
    steps.photometric().add_controllers(backend);
    progress.start(iterations.value_or(0), 0, "controller");
    std::int64_t k = 0;
    while (!is_done(k)) {
        if (interrupted() || watcher.ask(backend, false) == WatcherRequest::kStop) {
            progress.finish();
            return {.iterations = k, .stopped = true};
        }
        backend.distill(steps.controller_step(k, iterations));
        ++k;
        if (k % kStatsInterval == 0) monitor.read(backend);
        if (progress.due(k)) {
            monitor.settle(backend);
            if (!iterations) progress.expect_end_in(seconds_left().value_or(0));
            progress.update(k, monitor.last().loss, backend.count());
        }
    }
    monitor.settle(backend);
    progress.expect(k);
    progress.update(k, monitor.last().loss, backend.count());
    progress.finish();
    return {.iterations = k};
}

}  // namespace gs
