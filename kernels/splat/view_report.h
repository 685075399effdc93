// SPDX-License-Identifier: Apache-2.0
// What ranks say to each other of the views of a step, and what follows from it: on all ranks the same.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>

#include "kernels/base/portable.h"

namespace gs {

/// The loss of one view and its parts.
struct ViewLoss {
    double loss = 0, l1 = 0, ssim = 0;
    std::int64_t num_instances = 0;
};

/// Returns the loss of a view by the sums of its weighted differences and SSIM over pixels and channels.
GS_HD ViewLoss loss_of_sums(double l1, double ssim, float lambda_dssim, double weight_sum, std::int64_t num_instances) {
    const double norm = weight_sum > 0 ? 1 / (3 * weight_sum) : 0;
    l1 *= norm, ssim *= norm;
    return {norm > 0 ? (1 - lambda_dssim) * l1 + lambda_dssim * (1 - ssim) : 0, l1, ssim, num_instances};
}

/// What a rank says of a view when a step was computed. Only the rank that renders the view says more than how many
/// splats it has there.
struct ViewReport {
    ViewLoss loss;
    std::int64_t num_splats = 0;  ///< of the rank's own Gaussians, also where there was less room
    // Whether there was too little room for these splats, and for instances. The loss means nothing in the latter case.
    std::uint32_t lacks_splats = 0, lacks_instances = 0;
};
static_assert(sizeof(ViewReport) % 16 == 0, "reports travel between devices");

/// What becomes of a step: the last of these in this order that a report on its views asks for.
enum class Verdict : std::uint32_t {
    kTake,
    kSkip,   ///< a loss is not finite
    kRepeat  ///< some rank had too little room
};

GS_HD Verdict verdict_on(const ViewReport& report) {
    if (report.lacks_splats || report.lacks_instances) return Verdict::kRepeat;
    return gs_isfinite(report.loss.loss) ? Verdict::kTake : Verdict::kSkip;
}

inline Verdict verdict_on(std::span<const ViewReport> reports) {
    Verdict verdict = Verdict::kTake;
    for (const ViewReport& report : reports) verdict = std::max(verdict, verdict_on(report));
    return verdict;
}

}  // namespace gs
