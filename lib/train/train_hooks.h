// SPDX-License-Identifier: Apache-2.0
// The hooks of a training: what its caller is shown, is asked for and may replace.
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
    double psnr = 0, ssim = 0;  ///< means; PSNR in dB
    std::size_t views = 0;
};

/// A request of whoever watches a training.
enum class WatcherRequest {
    kNone,
    kSave,  ///< write a checkpoint and the point cloud
    kStop,  ///< as Ctrl-C: write a checkpoint and end
};

/// The state of a training between two iterations, for whoever watches it. The loss is that of a step a little earlier.
struct TrainProgress {
    std::int64_t iteration = 0, num_gaussians = 0;
    std::int64_t expected_iterations = 0;  ///< of the whole run; 0 while time decides
    std::optional<double> seconds_left;    ///< of a time limit
    double loss = 0, train_seconds = 0;
    /// Whether all rows of the model are up to date, so that reading it now changes nothing of what follows.
    bool rows_current = false;
};

struct TrainHooks {
    /// Called before the first iteration and after every one. It may wait; its time does not count as training time.
    std::function<WatcherRequest(const TrainProgress& progress, Backend& backend)> between;
    /// Called when kSave was done, with what went wrong, or an empty text. Set wherever `between` is.
    std::function<void(std::int64_t iteration, const std::string& error)> saved;
    /// Called after `iteration` iterations if options.test_iterations lists it, and at the end, with the pruned model
    /// and `last`. Its time does not count as training time. The scores that it returns are written to the log.
    std::function<std::optional<TestScores>(std::int64_t iteration, Backend& backend, bool last)> evaluate;
    /// The most Gaussians that the final model may have; 0 = no limit but options.cap_max. Training has a tenth more,
    /// of which those with the lowest scores go at the end.
    std::int64_t most_gaussians = 0;
    /// Shows the course of the training, too; null: there is none.
    TensorBoard* tensorboard = nullptr;
    /// With options.target_psnr: measures the views held out for it.
    std::function<HeldOutPsnr(Backend& backend)> held_out_psnr;
    /// Replaces choose_backend if set.
    std::function<std::unique_ptr<Backend>(const AppearanceSpec&, const EngineOptions&)> make_backend;
};

/// Shows a training to whoever watches it, through TrainHooks::between. All references must outlive the object.
class Watcher {
  public:
    Watcher(const TrainHooks& hooks, const TrainingSchedule& schedule, const StepMonitor& monitor, TrainingClock& clock)
        : hooks_(hooks), schedule_(schedule), monitor_(monitor), clock_(clock) {}

    /// Shows the state of the training and returns what is asked for; kNone if nobody watches. A time limit does not
    /// count the time that this takes. `rows_current` as in TrainProgress.
    WatcherRequest ask(Backend& backend, bool rows_current) const;

  private:
    const TrainHooks& hooks_;
    const TrainingSchedule& schedule_;
    const StepMonitor& monitor_;
    TrainingClock& clock_;
};

}  // namespace gs
