// SPDX-License-Identifier: Apache-2.0
// A smaller scene with held-out views, on which short trainings are compared before a run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// The share of a time limit for the measurements before a run.
inline constexpr double kLimitShare = 0.1;

/// A smaller scene, and the options of trainings on it.
struct Stage {
    Scene scene;  ///< its test views are the held-out training views
    TrainOptions options;
    double pixels = 1;  ///< share of the pixels of the scene's images
};

/// Returns the scene with every 8th training view held out and images at most 400 pixels wide, and the options for a
/// training without view dependence there, with cap_max in proportion to the pixels.
Stage make_stage(const TrainOptions& options, const Scene& scene);

/// Returns the name of the model whose Gaussians have the same colour in every direction.
std::string plain_model();

/// Returns this share of a run's iterations, at least 1.
std::int64_t iterations_of(const TrainOptions& options, double share);

/// Returns the number of iterations that each of `trainings` trainings on the stage can have within `seconds`,
/// estimated from frames of its first Gaussians.
std::int64_t affordable_iterations(const Stage& stage, double seconds, double trainings);

}  // namespace gs
