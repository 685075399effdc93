// SPDX-License-Identifier: Apache-2.0
// Composes the request of one training step. Used by the trainer, trial trainings and `gsapp bench`.
#pragma once

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/densification.h"
#include "lib/train/learning_rates.h"
#include "lib/train/photometric.h"

namespace gs {

/// Returns a target that points into `image`, which must outlive it. The device identifies its cached images by `id`.
inline TargetImage target_image(const ViewImage& image, ImageId id = {}) {
    TargetImage t;
    t.id = id;
    t.width = image.color.width, t.height = image.color.height, t.channels = image.color.channels;
    t.u8 = image.color.is_float() ? nullptr : image.color.u8.data();
    t.f32 = image.color.is_float() ? image.color.f32.data() : nullptr;
    t.mask = image.mask ? image.mask->u8.data() : nullptr;
    return t;
}

/// One training view of a step.
struct StepView {
    std::size_t index = 0;                        ///< index into scene.train
    std::shared_ptr<const ViewImage> image = {};  ///< null: another rank reads the pixels
    Vec3<float> background{};
    int factor = 1;  ///< reduction factor of the image
};

/// Composes the request of one step: camera, photograph, learning rates, regularisers and photometric correction.
class StepComposer {
  public:
    /// `options` must be resolved. `photometric` determines the correction of views; if it is null, each view is
    /// corrected by its own parameters in the model's PPISP state, which learns at the full rate. `rate_factor`
    /// multiplies every learning rate and the noise. All references must outlive the object.
    StepComposer(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene,
                 const Photometric* photometric, double rate_factor = 1);

    /// Returns the request of the step on `view` at `moment`.
    StepRequest compose(const StepView& view, const ScheduleMoment& moment) const {
        return compose(view, moment, moment);
    }
    /// Returns the same request with the learning rates of `rate_moment`.
    StepRequest compose(const StepView& view, const ScheduleMoment& moment, const ScheduleMoment& rate_moment) const;

    /// Turns requests of single steps into the requests of one step on all their views. The rates of the first request
    /// apply, raised because a mean gradient is less noisy (docs/math/ranks.md#batch).
    static void combine(std::vector<StepRequest>& requests);

    /// Returns the request of a step that trains the controller of the view's camera (Backend::distill). `photometric`
    /// must not be null.
    StepRequest compose_distillation(const StepView& view, std::int64_t iteration) const;

    const LearningRates& rates() const { return rates_; }

  private:
    /// Returns the part of the request common to steps of the model and of the controller: the view and the loss of its
    /// image.
    StepRequest request_of(const StepView& view, std::int64_t iteration) const;

    const OptimizerOptions options_;
    const Strategy strategy_;
    const double ppisp_rate_;
    const std::uint64_t seed_;
    const Scene& scene_;
    const Photometric* photometric_;
    const LearningRates rates_;
    const DensificationWindow window_;
    const double rate_factor_;
};

}  // namespace gs
