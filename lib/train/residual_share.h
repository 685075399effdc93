// SPDX-License-Identifier: Apache-2.0
// Decides which Gaussians keep a residual (docs/math/residuals.md).
#pragma once

#include <optional>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// The positions at which residuals are removed, each time by the same factor. At the last position MCMC densification
/// is over, and the rest of the run recovers part of the loss. Until then the residuals help the other parameters
/// converge.
inline constexpr double kResidualStages[] = {15000, 18000, 21000, 25000};

/// The largest share of Gaussians that keeps a residual if the tolerance decides: less than 40 % of the bytes of sh or
/// sv for all. The immediate loss hardly predicts the final loss (docs/math/residuals.md#on-a-gpu).
inline constexpr double kMostAutoShare = 0.35;

/// Returns the share of Gaussians with a residual that options.appearance_bytes or appearance_share sets, 1 for a model
/// without residuals; nothing if the tolerance decides. Throws UsageError if appearance_bytes is less than a base
/// colour takes.
std::optional<double> wanted_residual_share(const AppearanceOptions& options, const AppearanceSpec& appearance);

/// A change in the set of residuals.
struct ResidualChange {
    std::int64_t pruned = 0;             ///< number of invisible Gaussians, which are removed first
    std::int64_t before = 0, after = 0;  ///< number of Gaussians with a residual
    double loss = 0;  ///< mean immediate loss of PSNR on the training views, dB; measured only if the tolerance decides
};

/// Removes residuals until only the share that the options request keeps one. Call before_step() before every step and
/// at_end() after the last step.
class ResidualShare {
  public:
    /// All arguments must outlive the object.
    ResidualShare(const AppearanceOptions& options, const AppearanceSpec& appearance, const Scene& scene);

    /// Removes residuals before the step at `moment` if a stage is due. If the tolerance decides, the last stage goes
    /// on removing the least valuable residuals until the immediate loss reaches a quarter of the tolerance. Returns
    /// nothing if no stage was due.
    std::optional<ResidualChange> before_step(Backend& backend, const ScheduleMoment& moment,
                                              const StepSource& step_on) const;
    /// Returns the largest number of views that at_end() evaluates.
    std::size_t views_at_end() const;
    /// Removes the residuals in excess of the share after the last removal of Gaussians. Returns nothing if there were
    /// none.
    std::optional<ResidualChange> at_end(Backend& backend, const StepSource& step_on) const;

  private:
    const double tolerance_;  ///< largest loss of PSNR, dB
    const Scene& scene_;
    const std::optional<double> share_;
};

}  // namespace gs
