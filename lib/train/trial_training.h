// SPDX-License-Identifier: Apache-2.0
// Trains short segments in memory, without files, progress or controllers. `--appearance auto` compares models by them.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/photometric.h"
#include "lib/train/training_views.h"

namespace gs {

/// The backend after a trial, and its time.
struct TrialResult {
    std::unique_ptr<Backend> backend;
    double seconds = 0;  ///< time of the steps
};

/// Trains one model for a while, and then others from there. begin() comes first, and continue_with() for each model.
class TrialTraining {
  public:
    /// Takes validated `options` and a `scene` with at least one training view; both outlive the object. PPISP is on or
    /// off: there is nothing to decide.
    TrialTraining(const TrainOptions& options, const Scene& scene);

    /// Trains the first `iterations` of a run of the options' appearance.
    TrialResult begin(std::int64_t iterations);

    /// Goes on from `state` with another appearance, which starts without a residual and has all degrees active. No
    /// Gaussian is added or moved elsewhere; learning rates go through what a run has left, compressed, so that the
    /// model comes to rest. Every call sees the same views. Empty if that would take more than `most_seconds`: before
    /// the rates have fallen a model cannot be compared. Throws NumericError when the loss stays non-finite,
    /// Interrupted after Ctrl-C.
    std::optional<TrialResult> continue_with(const Gaussians& state, const AppearanceSpec& appearance,
                                             std::int64_t iterations, double most_seconds);

    Vec3<float> background() const { return views_.fixed_background(); }
    /// Returns the image of a training view, from the cache of the steps.
    std::shared_ptr<const ViewImage> image(std::size_t view) { return views_.image(view); }

  private:
    /// Returns false if it was stopped for the time.
    bool run(TrialResult& result, const std::string& model, std::int64_t iterations, std::int64_t first,
             double most_seconds, const std::function<StepRequest(std::int64_t, const StepView&)>& compose);

    const TrainOptions options_;
    const Scene& scene_;
    TrainingViews views_;
    Photometric photometric_;
    std::int64_t begun_ = 0;  ///< iterations of `begin`
};

}  // namespace gs
