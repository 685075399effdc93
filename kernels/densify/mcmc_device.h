// SPDX-License-Identifier: Apache-2.0
// The decisions of MCMC densification (docs/math/densification.md#mcmc), the same on every backend.
#pragma once

#include <algorithm>

#include "kernels/base/portable.h"
#include "kernels/base/rng.h"
#include "kernels/densify/rows_device.h"
#include "kernels/requests.h"
#include "kernels/state/adam_device.h"

namespace gs {

// The opacity and scale of Gaussians that share the position of one Gaussian (docs/math/densification.md#relocation).

/// Largest supported number of copies at one position (the limit of the reference's table).
inline constexpr int kMaxRelocationCopies = 50;

/// The opacity and scale of each of n copies.
struct Relocated {
    double opacity;       ///< opacity of each copy, not clamped
    double scale_factor;  ///< factor on linear scales
};

/// Returns the values of n copies that together look like one Gaussian of this opacity (MCMC paper Eq. 9; the
/// hockey-stick identity collapses the double sum to a single one). Uses double, because in float the alternating sum
/// loses up to 4e-4 at n = 50.
GS_HD Relocated relocate(double opacity, int n) {
    const double o = gs_min(opacity, 1 - 1.1920928955078125e-7);  // exactly 1 would cancel completely
    n = n < 1 ? 1 : (n > kMaxRelocationCopies ? kMaxRelocationCopies : n);
    const double shared = -gs_expm1(gs_log1p(-o) / n);
    double sum = 0, binomial = 1, power = 1;
    for (int k = 1; k <= n; ++k) {
        binomial *= double(n - k + 1) / k;
        power *= shared;
        sum += (k % 2 ? 1.0 : -1.0) * binomial * power / gs_sqrt(double(k));
    }
    if (!(sum > 1e-12)) return {opacity, 1.0};
    return {shared, o / sum};
}

GS_HD bool is_dead(float raw_opacity, const float* q, float dead_logit) {
    return !(raw_opacity > dead_logit) || !usable_rotation(q);
}

/// Returns the weight of a row in draws, in units of 2^-32 of opacity; 0 for NaN. It is an integer, because sums of
/// integers are exact in any order. So a parallel prefix sum draws the same rows as a serial one. 2^32 rows cannot
/// overflow 64 bits.
GS_HD std::uint64_t sampling_weight(float raw_opacity) {
    const double opacity = sigmoid(double(raw_opacity));
    return opacity >= 0 ? std::uint64_t(opacity * 4294967296.0 + 0.5) : 0;
}

/// Returns the weight of a row for growth by opacity and gradient: the opacity times the square root of the norm of the
/// root mean square gradient of its base colour, in units of 2^-32. `second_moment` (3) is Adam's value from `missed`
/// steps ago.
GS_HD std::uint64_t gradient_weight(float raw_opacity, const float* second_moment, double missed) {
    const double sum = double(second_moment[0]) + second_moment[1] + second_moment[2];
    const double squared = sum * second_moment_decay(gs_max(missed, 0.0));
    const double weight = sigmoid(double(raw_opacity)) * gs_sqrt(gs_sqrt(squared));
    return weight >= 0 ? std::uint64_t(gs_clamp(weight, 0.0, 1.0) * 4294967296.0 + 0.5) : 0;
}

/// Returns the row of the k-th draw, with probability proportional to its weight. prefix_sums: (n), inclusive, the last
/// > 0.
GS_HD std::uint32_t draw_row(const std::uint64_t* prefix_sums, std::int64_t n, std::uint64_t seed, RngStream stream,
                             std::int64_t iteration, std::uint32_t k) {
    __extension__ using Wide = unsigned __int128;
    const Philox4 r = philox(seed, stream, std::uint64_t(iteration), k);
    // Uniform in [0, sum).
    const std::uint64_t target = std::uint64_t(Wide(std::uint64_t(r.v[0]) << 32 | r.v[1]) * prefix_sums[n - 1] >> 64);
    std::int64_t low = 0, high = n - 1;  // bisects for the first row whose sum is above the target
    while (low < high) {
        const std::int64_t middle = (low + high) / 2;
        if (prefix_sums[middle] > target)
            high = middle;
        else
            low = middle + 1;
    }
    return std::uint32_t(low);
}

/// New opacity and scale of a Gaussian and each of its copies.
struct McmcShare {
    float raw_opacity;
    float log_scale_shift;  ///< added to all three log scales
};

GS_HD McmcShare mcmc_share(float raw_opacity, int copies, float min_opacity) {
    const Relocated r = relocate(sigmoid(double(raw_opacity)), copies + 1);
    const double o = gs_clamp(r.opacity, double(min_opacity), 1 - 1.1920928955078125e-7);
    return {float(gs_log(o) - gs_log1p(-o)), float(gs_log(r.scale_factor))};
}

/// Returns the target number of Gaussians: n times params.growth, at least one more (fewer than 20 would never grow by
/// 5 %), and at most the cap. It is never below n.
inline std::int64_t mcmc_target(std::int64_t n, const McmcParams& params) {
    return std::max(n, std::min(params.cap, std::max(n + 1, std::int64_t(params.growth * double(n)))));
}

}  // namespace gs
