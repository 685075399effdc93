// SPDX-License-Identifier: Apache-2.0
// A smaller scene with held-out views, on which short trainings are compared before a run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Width in pixels to which wider images are reduced: differences between models appear sooner, in a fraction of the
/// time. (On lego sv, its best model, led sh by 0.22 dB after 2000 and 2000 iterations at 400 pixels, and by 0.07 after
/// 3000 and 1500 at 800 pixels with three times the Gaussians.)
inline constexpr int kStageWidth = 400;
/// The share of a time limit for the measurements before a run.
inline constexpr double kLimitShare = 0.1;

/// A smaller scene, and the options of trainings on it.
struct Stage {
    Scene scene;  ///< its test views are the held-out training views
    TrainOptions options;
    double pixels = 1;  ///< share of the pixels of the scene's images
};

/// Returns the scene with every 8th training view held out and images of at most `width` pixels, and the options for a
/// training without view dependence there, with cap_max in proportion to the pixels.
Stage make_stage(const TrainOptions& options, const Scene& scene, int width);

/// Returns the name of the model whose Gaussians have the same colour in every direction.
std::string plain_model();

/// Returns this share of a run's iterations, at least 1.
std::int64_t iterations_of(const TrainOptions& options, double share);

/// Returns the number of iterations that each of so many trainings on the stage can have within `seconds`, estimated
/// from frames of its first Gaussians.
std::int64_t affordable_iterations(const Stage& stage, double seconds, std::size_t trainings);

}  // namespace gs
