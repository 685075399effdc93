// SPDX-License-Identifier: Apache-2.0
// Learning rates of all groups over time (docs/math/optimization.md#learning-rates).
#pragma once

#include "appearance/model_info.h"
#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// The schedules of one run.
class LearningRates {
  public:
    LearningRates(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene);

    /// Fills the rates (and the noise factor, with MCMC) of the step after `iteration` finished ones.
    void apply(std::int64_t iteration, StepRequest& request) const;

    /// The camera spacing decides some rates, in the scene's unit: worth seeing where a scene trains oddly. `options`: the same.
    void log(const TrainOptions& options) const;

  private:
    Schedule means_, scales_, rotations_, opacities_;
    AppearanceRates appearance_;
    double noise_ = 0, spacing_ = 0;
};

/// Rate of the opacity logits: `opacity_lr`, or where that is NaN (auto) 0.025 (0.3536/d)^-0.6 for cameras `camera_spacing` = d
/// apart, kept in 0.025..0.05: close to the default of ADC in dense captures, to that of MCMC in sparse ones.
double opacity_rate(double opacity_lr, double camera_spacing);

/// Mean distance of a training camera to its 3 nearest neighbours, world units, at least 1e-6; 0.3536 (the distance that
/// leaves rates as they are) for a single camera.
double camera_spacing(const std::vector<View>& views);

}  // namespace gs
