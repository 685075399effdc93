// SPDX-License-Identifier: Apache-2.0
// Estimates how long a training on the CPU takes, from its first steps.
#pragma once

#include <cstdint>

#include "lib/core/train_options.h"

namespace gs {

/// The speed of the steps that a training has made so far.
struct MeasuredSteps {
    std::int64_t iteration = 0;        ///< iterations done
    double seconds_per_iteration = 0;  ///< mean of the latest ones
    std::int64_t num_gaussians = 0;    ///< that they had
    double pixels = 0;                 ///< of a training image, on average
};

/// Returns the seconds of all iterations that follow, with growth to `cap` Gaussians as the schedule has it. `options`
/// must be validated and end by iterations. With strategy adc, whose growth the scene decides, the number stays.
double estimate_seconds(const TrainOptions& options, const MeasuredSteps& steps, std::int64_t cap);

}  // namespace gs
