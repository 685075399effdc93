// SPDX-License-Identifier: Apache-2.0
// The learning rates of all groups over time (docs/math/optimization.md#learning-rates).
#pragma once

#include "appearance/model_info.h"
#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// The learning rate schedules of one run.
class LearningRates {
  public:
    LearningRates(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene);

    /// Returns the learning rates (and, with MCMC, the noise factor) of the step at `moment`, without the rate of
    /// PPISP.
    StepRates at(const ScheduleMoment& moment) const;

    /// Logs the rates that depend on the camera spacing, and the spacing in frame units, to help diagnose a scene that
    /// trains badly. `options` must be those of the constructor.
    void log(const TrainOptions& options) const;

  private:
    const ScheduleMark means_end_;
    Schedule means_, scales_, rotations_, opacities_;
    AppearanceRates appearance_;
    double noise_ = 0, spacing_ = 0;
    double feature_factor_, residual_factor_, final_rate_, short_rates_, base_travel_;
    double opacities_fall_from_;
    Vec3<float> center_{0, 0, 0};
    float extent_, far_rate_;
};

/// Returns the learning rate of the opacity logits: `opacity_lr`, or if that is empty (auto) 0.025 (0.3536/d)^-0.6 for
/// `camera_spacing` = d, clamped to 0.025..0.05. The automatic rate is close to the default of ADC in dense captures
/// and to that of MCMC in sparse captures.
double opacity_rate(const std::optional<double>& opacity_lr, double camera_spacing);

/// Returns the mean distance of a camera of `views` to its 3 nearest neighbours, in frame units, at least 1e-6. For
/// fewer than two cameras returns 0.3536, the spacing that leaves rates unchanged.
double camera_spacing(const std::vector<View>& views);

}  // namespace gs
