// SPDX-License-Identifier: Apache-2.0
// Reports the costs of a run: its memory before and after, the data that ranks exchanged, and the time of a training on
// the CPU, estimated from its first steps.
#pragma once

#include <cstdint>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Logs the planned memory: images against their budget, the model at its start and at the cap, and one view. Warns if
/// the sum exceeds the machine's memory.
void log_memory_plan(const TrainOptions& options, const Scene& scene, const AppearanceSpec& appearance,
                     std::int64_t num_gaussians);

/// Returns one line with the peak and current memory of the device, and each row with its bytes per item.
std::string memory_report(const MemoryUse& memory);

/// Logs the mean data that rank 0 sent in a step, and the share of the steps' time spent in exchanges.
void log_exchanges(const RankCosts& costs);

/// The speed of the steps that a training has made so far.
struct MeasuredSteps {
    std::int64_t iteration = 0;        ///< number of finished iterations
    double seconds_per_iteration = 0;  ///< mean of the latest iterations
    std::int64_t num_gaussians = 0;    ///< number of Gaussians in these iterations
    double pixels = 0;                 ///< mean number of pixels of a training image
};

/// Returns the estimated time of all remaining iterations, in seconds, with the schedule's growth up to `cap`
/// Gaussians. `options` must be resolved, and the run must end by iterations. With strategy adc, whose growth depends
/// on the scene, the number of Gaussians is taken to stay constant.
double estimate_seconds(const ScheduleOptions& options, const DensificationOptions& growth, const MeasuredSteps& steps,
                        std::int64_t cap);

/// Warns once if a training will take hours, as it does on the CPU with the defaults. Call update() after every step.
class LongTrainingWarning {
  public:
    /// `iteration` steps that took `train_seconds` precede the next step. `pixels` is the mean number of pixels of a
    /// training image, and `cap` the number of Gaussians to which the model grows. `options` must outlive the object.
    LongTrainingWarning(const TrainOptions& options, double pixels, std::int64_t cap, std::int64_t iteration,
                        double train_seconds);
    /// Warns once the steps so far took long enough for an estimate, if the estimate is long.
    void update(std::int64_t iteration, double train_seconds, std::int64_t num_gaussians);

  private:
    const ScheduleOptions& length_;
    const DensificationOptions& growth_;
    const double pixels_;
    const std::int64_t cap_, first_iteration_;
    const double first_seconds_;
    bool done_;
};

}  // namespace gs
