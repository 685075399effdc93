// SPDX-License-Identifier: Apache-2.0
// Makes the iterations of a training: the step on one or several views, and all changes of the model around it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/densification.h"
#include "lib/train/journal.h"
#include "lib/train/model_limits.h"
#include "lib/train/photometric.h"
#include "lib/train/residual_share.h"
#include "lib/train/step_composer.h"
#include "lib/train/training_schedule.h"
#include "lib/train/training_views.h"

namespace gs {

/// Trains a model step by step. begin() or resume() comes first, then use(), then any number of steps, then
/// remove_surplus(), and after the last change of the Gaussians the controllers.
class StepRunner {
  public:
    /// All arguments must outlive the object. `limits` bound the growth and the final model, `schedule` says what is
    /// due, and `journal` gets the changes of the model.
    StepRunner(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance, ModelLimits& limits,
               TrainingSchedule& schedule, Journal& journal);

    /// Returns the first model of a new run with the degree and the photometric correction that it begins with. Made
    /// from points it has the first degree, else its own.
    Gaussians begin(Gaussians first, bool from_points);
    /// Returns the model of a checkpoint at the schedule's present moment, with PPISP if that begins only here. Throws
    /// what Photometric::resume throws.
    Gaussians resume(Gaussians state);
    /// Divides the views of a step as the backend wants them, whose images are then decoded ahead.
    void use(const Backend& backend);
    /// Starts decoding the images of the next steps.
    void prefetch();

    /// Takes one step and moves the schedule on. Throws DataError before anything is changed when an image cannot be
    /// read, and what the backend throws.
    void take(Backend& backend);

    /// Removes what is not written: Gaussians that cannot be seen or that a limit forbids, and residuals above the
    /// share.
    void remove_surplus(Backend& backend);
    /// Returns the seconds that remove_surplus() may take.
    double seconds_to_remove(Backend& backend) const;
    /// Returns whether remove_surplus() chooses residuals by the training views, which is then part of the training.
    bool chooses_residuals() const { return residuals_.views_at_end() > 0; }

    /// Returns step k, from 0, of training the PPISP controllers, which takes `steps` in all if that is known.
    StepRequest controller_step(std::int64_t k, const std::optional<std::int64_t>& steps);

    const Photometric& photometric() const { return photometric_; }
    TrainingViews& views() { return views_; }
    const LearningRates& rates() const { return composer_.rates(); }
    /// Returns the learning rates of the last step.
    StepRates last_rates() const { return composer_.rates().at(last_moment_); }
    int active_degree() const { return densification_.active_degree(); }

  private:
    std::vector<StepView> next_views(Backend& backend);
    std::int64_t end_of_views() const;
    void decide_photometric(Backend& backend, const ScheduleMoment& moment);
    StepSource steps_on_views(const ScheduleMoment& moment);

    const TrainOptions& options_;
    ModelLimits& limits_;
    TrainingSchedule& schedule_;
    Journal& journal_;
    TrainingViews views_;
    DensificationSchedule densification_;
    Photometric photometric_;
    const StepComposer composer_;
    const ResidualShare residuals_;
    ScheduleMoment last_moment_;  ///< of the last step
};

}  // namespace gs
