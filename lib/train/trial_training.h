// SPDX-License-Identifier: Apache-2.0
// Trains short segments in memory, without files, progress or controllers. What they show decides before a run on its
// appearance, photometric correction and cameras.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/training_views.h"

namespace gs {

/// The backend after a trial, and the time of the trial.
struct TrialResult {
    std::unique_ptr<Backend> backend;
    double seconds = 0;  ///< time of the steps
};

/// Trains a model for a while, and continues from its state in several ways. Options that are given to begin() and
/// continue_with() must be valid, with PPISP on or off (not auto), and may differ from those of the constructor in the
/// number of iterations, appearance and PPISP.
class TrialTraining {
  public:
    /// `scene` must have a training view, and must outlive the object.
    TrialTraining(const TrainOptions& options, const Scene& scene);

    /// Trains the first `iterations` iterations of a run with these options. Also learns `cameras` if they are given;
    /// they must be those of the scene.
    TrialResult begin(const TrainOptions& options, std::int64_t iterations, CameraRefinement* cameras = nullptr);

    /// Continues from a state of a model without residual, after as many iterations as the last begin() had. The
    /// appearance's residual begins at zero with all degrees active, PPISP where the state has it or else here. No
    /// Gaussian is added or relocated. Learning rates, but for PPISP's, follow the rest of a run's schedule in
    /// compressed form, so that the model converges. Every call uses the same views. Returns nothing after more than
    /// `most_seconds`, since models are comparable only after the rates have fallen. Throws NumericError if parameters
    /// or losses stay non-finite, Interrupted after Ctrl-C.
    std::optional<TrialResult> continue_with(const Gaussians& state, const TrainOptions& options,
                                             std::int64_t iterations,
                                             double most_seconds = std::numeric_limits<double>::infinity());

    Vec3<float> background() const { return views_.fixed_background(); }
    /// Returns the image of a training view, from the cache of the steps.
    std::shared_ptr<const ViewImage> image(std::size_t view) { return views_.image(view); }

  private:
    /// Returns false if `most_seconds` ran out.
    bool run(TrialResult& result, const std::string& model, std::int64_t iterations, std::int64_t first,
             double most_seconds, const std::function<StepRequest(std::int64_t, const StepView&)>& compose);

    const Scene& scene_;
    TrainingViews views_;
    std::int64_t begun_ = 0;  ///< number of iterations of begin()
};

}  // namespace gs
