// SPDX-License-Identifier: Apache-2.0
// The hooks of a training: functions by which its caller observes it, controls it and replaces parts of it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"

namespace gs {

class StepMonitor;
class TensorBoard;
class TrainingClock;
class TrainingSchedule;

/// The mean PSNR of held-out views and its standard error, dB.
struct HeldOutPsnr {
    double mean = 0, standard_error = 0;
};

/// The scores of test views.
struct TestScores {
    double psnr = 0, ssim = 0;  ///< means over the views; PSNR in dB
    std::size_t views = 0;
};

/// A request of a training's watcher.
enum class WatcherRequest {
    kNone,
    kSave,  ///< write a checkpoint and the point cloud
    kStop,  ///< like Ctrl-C: write a checkpoint and end
};

/// The state of a training between two iterations, for a watcher. The loss is from a slightly earlier step.
struct TrainProgress {
    std::int64_t iteration = 0, num_gaussians = 0;
    std::int64_t expected_iterations = 0;  ///< number of iterations of the whole run; 0 under a time limit
    std::optional<double> seconds_left;    ///< seconds left of a time limit
    double loss = 0, train_seconds = 0;
    /// Whether all rows of the model are up to date, so that reading the model now does not change later steps.
    bool rows_current = false;
};

struct TrainHooks {
    /// Called before the first iteration and after every iteration. It may block; its time does not count as training
    /// time.
    std::function<WatcherRequest(const TrainProgress& progress, Backend& backend)> between;
    /// Called after a kSave request was carried out, with the error message or an empty text. Must be set if `between`
    /// is set.
    std::function<void(std::int64_t iteration, const std::string& error)> saved;
    /// Called after `iteration` iterations if options.test_iterations lists it, and at the end, with the pruned model
    /// and `last`. Its time does not count as training time. The returned scores are written to the log.
    std::function<std::optional<TestScores>(std::int64_t iteration, Backend& backend, bool last)> evaluate;
    /// The largest number of Gaussians of the final model; 0 = no limit besides options.cap_max. Training may use a
    /// tenth more; at the end the Gaussians with the lowest scores are removed.
    std::int64_t most_gaussians = 0;
    /// Event file that also records the course of the training; null = none.
    TensorBoard* tensorboard = nullptr;
    /// Measures the views held out for options.target_psnr. Must be set if that option is set.
    std::function<HeldOutPsnr(Backend& backend)> held_out_psnr;
    /// Replaces gs::make_backend if set.
    std::function<std::unique_ptr<Backend>(const AppearanceSpec&, const EngineOptions&)> make_backend;
};

/// Reports the state of a training to its watcher through TrainHooks::between. All references must outlive the object.
class Watcher {
  public:
    Watcher(const TrainHooks& hooks, const TrainingSchedule& schedule, const StepMonitor& monitor, TrainingClock& clock)
        : hooks_(hooks), schedule_(schedule), monitor_(monitor), clock_(clock) {}

    /// Reports the state of the training and returns the watcher's request; kNone without a watcher. The time of the
    /// call does not count towards a time limit. `rows_current` as in TrainProgress.
    WatcherRequest ask(Backend& backend, bool rows_current) const;

  private:
    const TrainHooks& hooks_;
    const TrainingSchedule& schedule_;
    const StepMonitor& monitor_;
    TrainingClock& clock_;
};

}  // namespace gs
