// SPDX-License-Identifier: Apache-2.0
// Decides which Gaussians keep a residual (docs/math/residuals.md).
#pragma once

#include <optional>

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/timeline.h"

namespace gs {

/// The position at which residuals are taken away: densification by MCMC is over, and the rest of the run makes up for
/// part of the loss. Earlier it costs more, since residuals also help everything else to find its place.
inline constexpr double kResidualChoice = 25000;

/// Returns the share of Gaussians that options.appearance_bytes or appearance_share asks for, 1 for a model without
/// residuals; nothing where the tolerance decides. Throws UsageError for fewer bytes than a base colour takes.
std::optional<double> wanted_residual_share(const TrainOptions& options, const AppearanceSpec& appearance);

/// What became of the residuals.
struct ResidualChange {
    std::int64_t before = 0, after = 0;  ///< Gaussians with a residual
    double loss = 0;  ///< dB that the PSNR of training views fell by at once, on average; only known with a tolerance
};

class ResidualShare {
  public:
    /// All arguments must outlive the object.
    ResidualShare(const TrainOptions& options, const AppearanceSpec& appearance, const Scene& scene);

    /// Takes residuals away before the step at `moment`, if that is due. Returns nothing if it was not.
    std::optional<ResidualChange> before_step(Backend& backend, const Moment& moment, const StepSource& step_on) const;

  private:
    /// Takes away as many residuals as the tolerance allows, those that are worth least first.
    ResidualChange choose_by_loss(Backend& backend, ResidualScores scores, const StepSource& step_on) const;

    const TrainOptions& options_;
    const Scene& scene_;
    const std::optional<double> share_;
};

}  // namespace gs
