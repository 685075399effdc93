// SPDX-License-Identifier: Apache-2.0
// Tells the costs of a run: its memory before it starts and after, the data that ranks exchanged, and the time of a
// training on the CPU, from its first steps.
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

/// Logs how much data rank 0 sent in a step, and the share of the steps' time that went into exchanges.
void log_exchanges(const RankCosts& costs);

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

/// Warns once of a training that takes hours, as one with the defaults does on the CPU. update() follows every step.
class LongTrainingWarning {
  public:
    /// The next step follows `iteration` others, which took `train_seconds`. Training images have `pixels` on average,
    /// and the model grows to `cap` Gaussians. `options` must outlive the object.
    LongTrainingWarning(const TrainOptions& options, double pixels, std::int64_t cap, std::int64_t iteration,
                        double train_seconds);
    /// Warns if the steps so far took long enough to tell.
    void update(std::int64_t iteration, double train_seconds, std::int64_t num_gaussians);

  private:
    const TrainOptions& options_;
    const double pixels_;
    const std::int64_t cap_, first_iteration_;
    const double first_seconds_;
    bool done_;
};

}  // namespace gs
