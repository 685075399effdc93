// SPDX-License-Identifier: Apache-2.0
// When the set of Gaussians changes (optimization spec section 1, densification spec).
#pragma once

#include "kernels/backend.h"
#include "lib/core/train_options.h"

namespace gs {

/// Everything that happens before the step of an iteration: degree, densification, Morton order, opacity reset.
class DensificationSchedule {
  public:
    /// `options` validated; `black_background` spares ADC its early extra reset.
    DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance, double extent, bool black_background);

    /// Runs what is due at `iteration` (0-based). Returns what densification did; all zero where it was not due.
    DensifyStats apply(Backend& backend, std::int64_t iteration);

    /// The degree active in the step of `iteration`: one more at 1000, 2000, ...
    int active_degree(std::int64_t iteration) const;

    /// Whether ADC still needs the gradient statistic of this iteration.
    bool gathers(std::int64_t iteration) const;

  private:
    const TrainOptions& options_;
    int initial_degree_, max_degree_;
    double extent_;
    bool black_background_;
};

}  // namespace gs
