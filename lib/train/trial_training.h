// SPDX-License-Identifier: Apache-2.0
// Trains short segments in memory, without files, progress or controllers. `--appearance auto` uses them to compare
// appearance models, `--refine-cameras auto` to compare given with learned cameras.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/photometric.h"
#include "lib/train/training_views.h"

namespace gs {

/// The backend after a trial, and the time of the trial.
struct TrialResult {
    std::unique_ptr<Backend> backend;
    double seconds = 0;  ///< time of the steps
};

/// Trains one appearance model for a while, then continues from its state with other appearance models. Call begin()
/// first, then continue_with() for each model.
class TrialTraining {
  public:
    /// `options` must be valid, with PPISP on or off (not auto), and `scene` must have a training view. `scene` must
    /// outlive the object.
    TrialTraining(const TrainOptions& options, const Scene& scene);

    /// Trains the first `iterations` iterations of a run with the options' appearance. Also learns `cameras` if
    /// they are given; they must be those of the scene.
    TrialResult begin(std::int64_t iterations, CameraRefinement* cameras = nullptr);

    /// Continues from `state` with another appearance, whose residual begins at zero with all degrees active. No
    /// Gaussian is added or relocated. The learning rates follow the rest of a run's schedule in compressed form, so
    /// that the model converges. Every call uses the same views. Returns nothing after more than `most_seconds`, since
    /// models are comparable only after the rates have fallen. Throws NumericError if parameters or losses stay
    /// non-finite, Interrupted after Ctrl-C.
    std::optional<TrialResult> continue_with(const Gaussians& state, const AppearanceSpec& appearance,
                                             std::int64_t iterations, double most_seconds);

    Vec3<float> background() const { return views_.fixed_background(); }
    /// Returns the image of a training view, from the cache of the steps.
    std::shared_ptr<const ViewImage> image(std::size_t view) { return views_.image(view); }

  private:
    /// Returns false if `most_seconds` ran out.
    bool run(TrialResult& result, const std::string& model, std::int64_t iterations, std::int64_t first,
             double most_seconds, const std::function<StepRequest(std::int64_t, const StepView&)>& compose);

    const TrainOptions options_;
    const Scene& scene_;
    TrainingViews views_;
    Photometric photometric_;
    std::int64_t begun_ = 0;  ///< number of iterations of begin()
};

}  // namespace gs
