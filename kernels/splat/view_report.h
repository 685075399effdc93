// SPDX-License-Identifier: Apache-2.0
// The loss of a view, the report of a rank on it, and the decision on a step from all reports.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "kernels/base/portable.h"

namespace gs {

/// The loss of one view and its terms, as means over the pixels.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
};

/// Weights of the terms of the loss (docs/math/optimization.md).
struct LossWeights {
    float lambda_dssim = 0.2f;  ///< weight of 1 - SSIM; the L1 difference has weight 1 - lambda_dssim
    float opacity_reg = 0.01f;  ///< weight of mean(opacity)
    float scale_reg = 0.01f;    ///< weight of mean(exp(raw_scale))
};

/// Returns the loss of a view, without regularisers, from the sums of its weighted differences and SSIM over pixels and
/// channels. `weight_sum` is the sum of the weights of the pixels; if it is 0, the loss is 0.
GS_HD ViewLoss loss_of_sums(double l1_sum, double ssim_sum, const LossWeights& weights, double weight_sum,
                            std::int64_t num_instances = 0) {
    if (!(weight_sum > 0)) return {0, 0, 0, num_instances};
    const double norm = 1 / (3 * weight_sum), l1 = l1_sum * norm, ssim = ssim_sum * norm;
    const double lambda = weights.lambda_dssim;
    return {(1 - lambda) * l1 + lambda * (1 - ssim), l1, ssim, num_instances};
}

/// Report of a rank on a view of a step. Ranks that do not render the view only report their number of splats in it.
struct ViewReport {
    ViewLoss loss;
    std::int64_t num_splats = 0;  ///< number for the rank's own Gaussians, even if there was less room
    // Whether there was too little room for these splats, and for instances. The loss is meaningless in the latter
    // case.
    std::uint32_t lacks_splats = 0, lacks_instances = 0;
};
static_assert(sizeof(ViewReport) % 16 == 0, "reports travel between devices");

/// Outcome of a step: the last of these values in this order that any report on its views demands.
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
