// SPDX-License-Identifier: Apache-2.0
// Runs the iterations of a training: the step on one or several views, and all changes of the model around it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/densification.h"
#include "lib/train/journal.h"
#include "lib/train/model_limits.h"
#include "lib/train/photometric.h"
#include "lib/train/residual_share.h"
#include "lib/train/step_composer.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {

/// Trains a model step by step. Call begin() or resume() first, then use(), then take() any number of times, then
/// remove_surplus(), and controller_step() after the last change of the Gaussians.
class StepRunner {
  public:
    /// All arguments must outlive the object. Training views of `scene` get the cameras that are learned. `limits`
    /// bounds the growth and the final model, `schedule` determines the position in the run, and `journal` records the
    /// changes of the model.
    StepRunner(const TrainOptions& options, Scene& scene, const AppearanceSpec& appearance, ModelLimits& limits,
               TrainingSchedule& schedule, Journal& journal);

    /// Returns the first model of a new run with its initial active degree and photometric correction. A model made
    /// from points gets the initial degree; another model keeps its own.
    Gaussians begin(Gaussians first, bool from_points);
    /// Returns the model of a checkpoint for the schedule's current moment, with the initial PPISP state if PPISP
    /// begins only here. Throws what Photometric::resume throws.
    Gaussians resume(Gaussians state, const CameraState& cameras);
    /// Sets the views of a step, and the images to decode ahead, to those that the backend needs.
    void use(const Backend& backend);
    /// Starts decoding the images of the next steps.
    void prefetch();

    /// Takes one step and advances the schedule. Throws DataError before any change if an image cannot be read, and
    /// what the backend throws.
    void take(Backend& backend);

    /// Removes all that is not saved in the final model: Gaussians that are invisible or exceed a limit, and residuals
    /// in excess of the share.
    void remove_surplus(Backend& backend);
    /// Returns the time that remove_surplus() may take, in seconds.
    double seconds_to_remove(Backend& backend) const;
    /// Returns whether remove_surplus() ranks residuals by the training views, in which case its time counts as
    /// training.
    bool chooses_residuals() const { return residuals_.views_at_end() > 0; }

    /// Returns the request of step k, from 0, of training the PPISP controllers. `steps` is the total number of these
    /// steps, if known.
    StepRequest controller_step(std::int64_t k, const std::optional<std::int64_t>& steps);

    const Photometric& photometric() const { return photometric_; }
    CameraRefinement& cameras() { return cameras_; }
    TrainingViews& views() { return views_; }
    const LearningRates& rates() const { return composer_.rates(); }
    /// Returns the learning rates of the last step.
    StepRates last_rates() const { return composer_.rates().at(last_moment_); }
    int active_degree() const { return densification_.active_degree(); }

  private:
    void start_antialiasing(Gaussians& state);
    std::vector<StepView> next_views(Backend& backend);
    std::int64_t end_of_views() const;
    StepSource steps_on_views(const ScheduleMoment& moment);

    const OutputOptions& output_;
    const ScheduleOptions& length_;
    const Antialiasing antialiasing_;
    const Scene& scene_;
    ModelLimits& limits_;
    TrainingSchedule& schedule_;
    Journal& journal_;
    TrainingViews views_;
    DensificationSchedule densification_;
    Photometric photometric_;
    CameraRefinement cameras_;
    const StepComposer composer_;
    const ResidualShare residuals_;
    ScheduleMoment last_moment_;                      ///< moment of the last step
    std::vector<CameraParams<float>> sharp_cameras_;  ///< training views that limit the detail; empty: no 3-D filter
};

}  // namespace gs
