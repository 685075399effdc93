// SPDX-License-Identifier: Apache-2.0
// Properties of one row: whether it can be seen, whether its values are valid, and its position on the Morton curve.
#pragma once

#include "kernels/splat/smoothing_device.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns the raw value of an opacity. Only for the host, so that all backends compare with exactly the same float.
inline float logit(float opacity) { return std::log(opacity / (1 - opacity)); }

/// Returns whether the quaternion of 4 values has a direction.
GS_HD bool usable_rotation(const float* q) { return usable_rotation(Vec4<float>{q[0], q[1], q[2], q[3]}); }

/// Returns false if no view can show the Gaussian.
GS_HD bool is_visible(float raw_opacity, const float* q) {
    return sigmoid(raw_opacity) >= float(kMinAlpha) && usable_rotation(q);
}

/// The raw opacities of Gaussians whose 3-D filter is part of their scale: what views show of them.
struct ShownOpacities {
    const float *raw_opacities, *log_scales, *smoothing;  ///< `smoothing` is null without a filter

    static ShownOpacities of(const Gaussians& model) {
        const auto& smoothing = model[Group::kSmoothing];
        return {model[Group::kOpacity].param.data(), model[Group::kScale].param.data(),
                smoothing.width > 0 ? smoothing.param.data() : nullptr};
    }
    /// Returns that of row i, with log scales larger by `shift`.
    GS_HD float operator()(std::int64_t i, float shift = 0) const {
        if (!smoothing) return raw_opacities[i];
        const float* s = log_scales + 3 * i;
        const Vec3<double> log_scale{s[0] + shift, s[1] + shift, s[2] + shift};
        return float(smoothed(log_scale, double(raw_opacities[i]), double(smoothing[i])).raw_opacity);
    }
};

/// Largest magnitude of the parameters of each group. Training neither reaches it from valid values nor returns from
/// it: at its rate a base colour needs a million steps to 1e3, and the fastest residual needs 2000 steps in one
/// direction to 5e3. A Gaussian beyond it is broken like one with a NaN, and removed likewise.
inline constexpr float kLargestParameter[kNumGroups] = {1e15f, 1e3f, 1e8f, 1e3f, 1e3f, 5e3f, 1e30f};

/// Returns whether |x| is at most `largest`; false for NaN.
GS_HD bool in_range(float x, float largest) { return gs_abs(x) <= largest; }

/// The bounding box of the means. It is initially empty. NaN coordinates do not widen it.
struct MeanBounds {
    static constexpr float kMax = 3.402823466e38f;
    float low[3] = {kMax, kMax, kMax}, high[3] = {-kMax, -kMax, -kMax};

    GS_HD void add(const float* mean) { add(mean, mean); }
    GS_HD void add(const MeanBounds& other) { add(other.low, other.high); }
    GS_HD float extent() const {
        return gs_max(gs_max(gs_max(0.0f, high[0] - low[0]), high[1] - low[1]), high[2] - low[2]);
    }

  private:
    GS_HD void add(const float* a, const float* b) {
        for (int k = 0; k < 3; ++k) low[k] = gs_min(a[k], low[k]), high[k] = gs_max(b[k], high[k]);
    }
};

/// Returns bits 0..20 of x, spread three places apart.
GS_HD std::uint64_t spread_bits(std::uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

/// Returns the Morton code of a mean: 63 bits, 21 per axis, x lowest. All axes use the same cube side
/// (docs/math/densification.md#morton-order). NaN counts as the low side.
GS_HD std::uint64_t morton_code(const float* mean, const MeanBounds& bounds) {
    const float extent = bounds.extent();
    std::uint64_t code = 0;
    for (int k = 0; k < 3; ++k) {
        const float t = extent > 0 ? gs_clamp((mean[k] - bounds.low[k]) / extent, 0.0f, 1.0f) : 0.0f;
        code |= spread_bits(std::uint64_t(t * 2097151.0f)) << k;
    }
    return code;
}

}  // namespace gs
