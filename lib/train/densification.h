// SPDX-License-Identifier: Apache-2.0
// Schedules the changes of the set of Gaussians (docs/math/densification.md#schedule).
#pragma once

#include <functional>
#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/train/timeline.h"

namespace gs {

/// The interval, in positions, at which the active degree rises.
inline constexpr double kDegreeInterval = 1000;

/// The part of a run in which the number of Gaussians changes.
struct DensificationWindow {
    explicit DensificationWindow(const DensificationOptions& options);
    ScheduleMark from, until, interval;

    /// Returns whether an interval inside the window ends at `moment`. In short runs intervals span more positions, so
    /// that new Gaussians get enough steps to prove useful.
    bool due(const ScheduleMoment& moment) const;
};

/// The result of a densification, and the number of Gaussians that Speedy-Splat's pruning removed after it.
struct ScheduledChange : DensifyStats {
    std::int64_t pruned_by_score = 0;
};

/// Changes the set of Gaussians. Before each step, before_step() raises the degree, densifies, prunes, sorts along the
/// Morton curve and resets opacities. After each step, after_step() prunes. A resumed run calls resume() first.
class DensificationSchedule {
  public:
    /// `black_background` disables ADC's early extra opacity reset. `views` are all training views, used for the scores
    /// of Speedy-Splat's pruning. `extent` is in frame units.
    DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance, double extent,
                          bool black_background, std::vector<RenderRequest> views);

    /// Continues a run from a checkpoint with this active degree.
    void resume(int active_degree) { degree_ = active_degree; }

    /// Runs the changes due before the step at `moment`. If `hold_view_dependence` is set when the degree would rise,
    /// the degree becomes 0: colours do not depend on the view for now. `most` returns the largest number of Gaussians;
    /// if empty, options.cap_max applies. Returns the result of densification and pruning, all zero if neither was due.
    ScheduledChange before_step(Backend& backend, const ScheduleMoment& moment, bool hold_view_dependence = false,
                                const std::function<std::int64_t()>& most = {});

    /// Runs the changes due after the step at `moment`.
    ScheduledChange after_step(Backend& backend, const ScheduleMoment& moment);

    /// Returns the degree active in the last step. It rises by one at position 1000, 2000, ..., unless it is held.
    int active_degree() const { return degree_; }

  private:
    bool prunes_by_score(const ScheduleMoment& moment) const;
    void prune(Backend& backend, double ratio, ScheduledChange& change) const;

    const DensificationOptions options_;
    const std::int64_t cap_;
    const std::uint64_t seed_;
    int initial_degree_, max_degree_, degree_;
    double extent_;
    bool black_background_;
    const DensificationWindow window_;
    const ScheduleMark reset_;
    std::vector<RenderRequest> views_;
};

}  // namespace gs
