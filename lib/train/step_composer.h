// SPDX-License-Identifier: Apache-2.0
// Composes the request of one training step. Trainer, rehearsal and bench only loop over the result.
#pragma once

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/densification.h"
#include "lib/train/learning_rates.h"
#include "lib/train/photometric.h"

namespace gs {

/// One training view as a step uses it.
struct StepView {
    std::size_t index = 0;                   ///< index into scene.train
    std::shared_ptr<const ViewImage> image;  ///< null: its pixels are read elsewhere
    Vec3<float> background{};
    int level = 0;  ///< place of the image among those of its view: 0 for the full one, f - 1 if reduced f times
};

class StepComposer {
  public:
    /// `options` must be validated. `photometric` says how views are corrected; with null each is corrected by its own
    /// values in the model's PPISP, which learns at the full rate. `rate_factor` multiplies every learning rate and the
    /// noise. All references must outlive the object.
    StepComposer(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene,
                 const Photometric* photometric, double rate_factor = 1);

    /// Returns the step on `view` at `moment`.
    StepRequest compose(const StepView& view, const Moment& moment) const { return compose(view, moment, moment); }
    /// Returns the same step with the learning rates of another moment.
    StepRequest compose(const StepView& view, const Moment& moment, const Moment& rate_moment) const;

    /// Turns requests of single steps into those of one step on all their views: with the rates of the first, which
    /// are higher, since a mean gradient is less noisy (docs/math/ranks.md#batch).
    static void combine(std::vector<StepRequest>& requests);

    /// Returns a step that trains the controller of the view's camera (Backend::distill). Needs a `photometric`.
    StepRequest compose_distillation(const StepView& view, std::int64_t iteration) const;

    const LearningRates& rates() const { return rates_; }

  private:
    /// Returns the part that both kinds of steps have in common.
    StepRequest request_of(const StepView& view, std::int64_t iteration) const;

    const TrainOptions& options_;
    const Scene& scene_;
    const Photometric* photometric_;
    const LearningRates rates_;
    const DensificationWindow window_;
    const double rate_factor_;
};

}  // namespace gs
