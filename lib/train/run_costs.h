// SPDX-License-Identifier: Apache-2.0
// What a run takes: its memory, before it starts and after, and the time of a training on the CPU, from its first
// steps.
#pragma once

#include <cstdint>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Logs the memory of the images against their budget, of the model at its start and at the cap, and of one view. Warns
/// when the sum exceeds the machine's memory.
void log_memory_plan(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance,
                     std::int64_t num_gaussians);

/// Returns one line: peak and present bytes of the device, and each row with its bytes per item.
std::string memory_report(const MemoryUse& memory);

/// The speed of the steps that a training has made so far.
struct MeasuredSteps {
    std::int64_t iteration = 0;        ///< iterations done
    double seconds_per_iteration = 0;  ///< mean of the latest ones
    std::int64_t num_gaussians = 0;    ///< that they had
    double pixels = 0;                 ///< of a training image, on average
};

/// Returns the seconds of all iterations that follow, with growth to `cap` Gaussians as the schedule has it. `options`
/// must be resolved and end by iterations. With strategy adc, whose growth the scene decides, the number stays.
double estimate_seconds(const ScheduleOptions& options, const DensificationOptions& growth, const MeasuredSteps& steps,
                        std::int64_t cap);

}  // namespace gs
