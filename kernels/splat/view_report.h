// SPDX-License-Identifier: Apache-2.0
// The loss of a view, the report of a rank on it, and what all reports decide of a step.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "kernels/base/portable.h"

namespace gs {

/// The loss of one view and its parts, means over the pixels.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
};

/// The weights of the terms of the loss (docs/math/optimization.md).
struct LossWeights {
    float lambda_dssim = 0.2f;  ///< of 1 - SSIM; the L1 difference has one minus it
    float opacity_reg = 0.01f;  ///< of mean(opacity)
    float scale_reg = 0.01f;    ///< of mean(exp(raw_scale))
};

/// Returns the loss of a view, without regularisers, by the sums of its weighted differences and SSIM over pixels and
/// channels. `weight_sum` adds up the weights of the pixels; if it is 0, the loss is 0.
GS_HD ViewLoss loss_of_sums(double l1_sum, double ssim_sum, const LossWeights& weights, double weight_sum,
                            std::int64_t num_instances = 0) {
    if (!(weight_sum > 0)) return {0, 0, 0, num_instances};
    const double norm = 1 / (3 * weight_sum), l1 = l1_sum * norm, ssim = ssim_sum * norm;
    const double lambda = weights.lambda_dssim;
    return {(1 - lambda) * l1 + lambda * (1 - ssim), l1, ssim, num_instances};
}

/// What a rank says of a view when a step was computed. Only the rank that renders the view says more than how many
/// splats it has there.
struct ViewReport {
    ViewLoss loss;
    std::int64_t num_splats = 0;  ///< of the rank's own Gaussians, also if there was less room
    // Whether there was too little room for these splats, and for instances. The loss means nothing in the latter case.
    std::uint32_t lacks_splats = 0, lacks_instances = 0;
};
static_assert(sizeof(ViewReport) % 16 == 0, "reports travel between devices");

/// What becomes of a step: the last of these in this order that a report on its views asks for.
enum class StepDecision : std::uint32_t {
    kTake,
    kSkip,   ///< a loss is not finite
    kRepeat  ///< some rank had too little room
};

GS_HD StepDecision decide_step(const ViewReport& report) {
    if (report.lacks_splats || report.lacks_instances) return StepDecision::kRepeat;
    return gs_isfinite(report.loss.loss) ? StepDecision::kTake : StepDecision::kSkip;
}

inline StepDecision decide_step(std::span<const ViewReport> reports) {
    StepDecision decision = StepDecision::kTake;
    for (const ViewReport& report : reports) decision = std::max(decision, decide_step(report));
    return decision;
}

}  // namespace gs
