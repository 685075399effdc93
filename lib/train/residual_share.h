// SPDX-License-Identifier: Apache-2.0
// Decides which Gaussians keep a residual (docs/math/residuals.md).
#pragma once

#include <optional>

#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// The positions at which residuals are taken away, each time by the same factor. At the last one densification by MCMC
/// is over, and the rest of the run makes up for part of the loss. Earlier, residuals help everything else to find its
/// place.
inline constexpr double kResidualStages[] = {15000, 18000, 21000, 25000};

/// With a tolerance, at most this share keeps a residual: less than 40 % of the bytes of sh or sv for all. What that
/// costs at once says little of what it costs in the end (docs/math/residuals.md#on-a-gpu).
inline constexpr double kMostAutoShare = 0.35;

/// Returns the share of Gaussians that options.appearance_bytes or appearance_share asks for, 1 for a model without
/// residuals; nothing if the tolerance decides. Throws UsageError for fewer bytes than a base colour takes.
std::optional<double> wanted_residual_share(const AppearanceOptions& options, const AppearanceSpec& appearance);

/// A change in the set of residuals.
struct ResidualChange {
    std::int64_t pruned = 0;             ///< Gaussians that could not be seen, removed first
    std::int64_t before = 0, after = 0;  ///< Gaussians with a residual
    double loss = 0;  ///< dB that the PSNR of training views fell by at once, on average; only known with a tolerance
};

/// Leaves a residual to as many Gaussians as options ask for. before_step() precedes every step, and at_end() follows
/// the last one.
class ResidualShare {
  public:
    /// All arguments must outlive the object.
    ResidualShare(const AppearanceOptions& options, const AppearanceSpec& appearance, const Scene& scene);

    /// Takes residuals away before the step at `moment`, if that is due. With a tolerance the last stage goes on, those
    /// that are worth least first, until the loss at once reaches a quarter of it. Returns nothing if it was not due.
    std::optional<ResidualChange> before_step(Backend& backend, const ScheduleMoment& moment,
                                              const StepSource& step_on) const;
    /// Returns how many views at_end may look at.
    std::size_t views_at_end() const;
    /// Takes away the residuals above the share, once the last Gaussians are removed. Returns nothing if there were
    /// none.
    std::optional<ResidualChange> at_end(Backend& backend, const StepSource& step_on) const;

  private:
    const double tolerance_;  ///< dB
    const Scene& scene_;
    const std::optional<double> share_;
};

}  // namespace gs
