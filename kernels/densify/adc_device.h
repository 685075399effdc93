// SPDX-License-Identifier: Apache-2.0
// The decisions of adaptive density control (docs/math/densification.md#adc), the same on every backend.
#pragma once

#include <limits>

#include "kernels/base/rng.h"
#include "kernels/densify/rows_device.h"
#include "kernels/requests.h"

namespace gs {

/// Logit of opacity 0.01, the limit to which a reset lowers opacities.
inline constexpr float kResetLogit = -4.595119953155518f;
/// Logarithm of 1.6, the factor by which the children of a split are smaller. It is a constant so that no backend
/// computes it.
inline constexpr float kLogSplitShrink = 0.4700036292457356f;

/// Returns a raw opacity after the reset. NaN stays NaN.
GS_HD float reset_raw_opacity(float raw) { return raw > kResetLogit ? kResetLogit : raw; }

GS_HD float max_log_scale(const float* s) {
    const float m = s[0] < s[1] ? s[1] : s[0];
    return m < s[2] ? s[2] : m;
}

/// The thresholds of one densification. The host computes their logarithms.
struct AdcRule {
    float grad_threshold, dense, min_logit, large;

    static AdcRule of(const AdcParams& p) {
        return {p.grad_threshold, std::log(p.dense_fraction * p.extent), logit(p.min_opacity),
                p.prune_large ? std::log(0.1f * p.extent) : std::numeric_limits<float>::infinity()};
    }
    GS_HD bool grows(float gradient_sum, float views) const {
        return gradient_sum >= grad_threshold * gs_max(views, 1.0f);
    }
    /// Returns whether a growing Gaussian is cloned; otherwise it is split.
    GS_HD bool is_small(float max_scale) const { return max_scale <= dense; }
    GS_HD bool is_kept(float raw_opacity, const float* q, float max_scale) const {
        return raw_opacity >= min_logit && usable_rotation(q) && !(max_scale > large);
    }
};

/// Returns the sort key of a growing row; the strongest mean gradient comes first.
GS_HD float adc_rank(float gradient_sum, float views) { return -gradient_sum / gs_max(views, 1.0f); }

/// Converts a copy of row `parent` to its child 0 or 1, with a position drawn from the parent's distribution and a
/// smaller scale.
GS_HD void make_split_child(float* mean, float* log_scale, const float* q, std::uint32_t parent, std::uint32_t child,
                            std::int64_t iteration, std::uint64_t seed) {
    float xi[4];
    normals_from(philox(seed, RngStream::kSplit, std::uint64_t(iteration), 2 * parent + child), xi);
    const Vec3<float> sigma{gs_exp(log_scale[0]), gs_exp(log_scale[1]), gs_exp(log_scale[2])};
    const Vec3<float> offset =
        rotation_matrix(Vec4<float>{q[0], q[1], q[2], q[3]}) * (sigma * Vec3<float>{xi[0], xi[1], xi[2]});
    mean[0] += offset.x, mean[1] += offset.y, mean[2] += offset.z;
    for (int k = 0; k < 3; ++k) log_scale[k] -= kLogSplitShrink;
}

}  // namespace gs
