// SPDX-License-Identifier: Apache-2.0
// Puts the request of one training step together. Trainer, rehearsal and bench only loop over what it returns.
#pragma once

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/learning_rates.h"
#include "lib/train/photometric.h"

namespace gs {

/// One training view as a step sees it.
struct StepView {
    std::size_t index = 0;  ///< into scene.train
    const ViewImage& image; ///< must outlive the call of the backend that takes the request
    Vec3<float> background{};
};

class StepComposer {
  public:
    /// `options` validated. `photometric` says how views are corrected; null: each by its own values in the model's PPISP,
    /// which learns at the full rate. `rate_factor` multiplies every learning rate and the noise. All references outlive
    /// the object.
    StepComposer(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene, const Photometric* photometric,
                 double rate_factor = 1);

    /// The step on `view` after `iteration` finished ones.
    StepRequest compose(const StepView& view, std::int64_t iteration) const { return compose(view, iteration, iteration); }
    /// The same with learning rates as after `rate_iteration` steps.
    StepRequest compose(const StepView& view, std::int64_t iteration, std::int64_t rate_iteration) const;

    /// A step that trains the controller of the view's camera (Backend::distill). Needs a `photometric`.
    StepRequest compose_distillation(const StepView& view, std::int64_t iteration) const;

    const LearningRates& rates() const { return rates_; }

  private:
    /// What steps of both kinds have in common.
    StepRequest request_of(const StepView& view, std::int64_t iteration) const;

    const TrainOptions& options_;
    const Scene& scene_;
    const Photometric* photometric_;
    const LearningRates rates_;
    const double rate_factor_;
};

}  // namespace gs
