// SPDX-License-Identifier: Apache-2.0
// Schedules the changes of the set of Gaussians (docs/math/densification.md#schedule).
#pragma once

#include <vector>

#include "kernels/backend.h"
#include "lib/core/train_options.h"

namespace gs {

/// The iterations between steps of the active degree.
inline constexpr std::int64_t kDegreeInterval = 1000;

/// The result of a densification, and the number of Gaussians that Speedy-Splat's pruning removed after it.
struct ScheduledChange : DensifyStats {
    std::int64_t pruned_by_score = 0;
};

/// Everything that happens before the step of an iteration (degree, densification, pruning, Morton order, opacity
/// reset), and the pruning after a step.
class DensificationSchedule {
  public:
    /// `options` must be validated and outlive the object. `black_background` spares ADC its early extra reset. `views`
    /// are all training views, for the scores of Speedy-Splat's pruning. `extent` is in frame units.
    DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance, double extent,
                          bool black_background, std::vector<RenderRequest> views);

    /// Continues a run whose checkpoint has this degree.
    void resume(int active_degree) { degree_ = active_degree; }

    /// Runs the changes due before the step of `iteration` (0-based). `hold_view_dependence` is read where the degree
    /// would rise; with it colours do not depend on the view for now. Returns the result of densification and pruning,
    /// all zero if they were not due.
    ScheduledChange before_step(Backend& backend, std::int64_t iteration, bool hold_view_dependence = false);

    /// Runs the changes due after that step.
    ScheduledChange after_step(Backend& backend, std::int64_t iteration);

    /// Returns the degree active in the last step: one more at 1000, 2000, ..., unless it was held.
    int active_degree() const { return degree_; }

  private:
    bool prunes_by_score(std::int64_t iteration) const;
    void prune(Backend& backend, double ratio, ScheduledChange& change) const;

    const TrainOptions& options_;
    int initial_degree_, max_degree_, degree_;
    double extent_;
    bool black_background_;
    std::vector<RenderRequest> views_;
};

}  // namespace gs
