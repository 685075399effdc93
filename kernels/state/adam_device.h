// SPDX-License-Identifier: Apache-2.0
// Adam for one value (docs/math/optimization.md#adam).
#pragma once

#include <cmath>
#include <cstdint>

#include "kernels/base/lanes.h"

namespace gs {

inline constexpr double kAdamBeta1 = 0.9, kAdamBeta2 = 0.999;
/// Adam's beta2 for the shared weights. They get a gradient from every view, so they need less memory of past
/// gradients.
inline constexpr double kAdamBeta2Shared = 0.99;
/// Adam's epsilon. It is far below any relevant gradient: the step is lr * m / sqrt(v) for all of them.
inline constexpr double kAdamEpsilon = 1e-15;

/// The factors of step t, computed in double on the host. A step on several views counts as that many steps.
template <class T> struct AdamStep {
    T step_size;          ///< lr / (1 - beta1^t)
    T inverse_sqrt_bias;  ///< 1 / sqrt(1 - beta2^t)

    static AdamStep at(double rate, std::int64_t t, double beta2 = kAdamBeta2) {
        return {T(rate / (1 - std::pow(kAdamBeta1, double(t)))), T(1 / std::sqrt(1 - std::pow(beta2, double(t))))};
    }
};

/// The weights of a new gradient in the two moments, 1 - beta1 and 1 - beta2. For a step on several views they are the
/// weights of that many steps.
template <class T> struct AdamGains {
    T first, second;

    static AdamGains of(int views, double beta2 = kAdamBeta2) {
        return {T(1 - std::pow(kAdamBeta1, views)), T(1 - std::pow(beta2, views))};
    }
    GS_HD static AdamGains of_one() { return {T(1 - kAdamBeta1), T(1 - kAdamBeta2)}; }
};

/// Returns the factor of the second moment after `missed` steps without a gradient.
template <class T> GS_HD T second_moment_decay(T missed) {
    return gs_exp2(missed * T(-0.0014434168696687186));  // log2 0.999
}

/// Limit to which gradients are clamped. Squares of larger gradients exceed float's range, and an infinite second
/// moment makes the next step NaN.
inline constexpr double kLargestGradient = 1e18;

/// Takes one step: updates p, m and v in place. The gradient must be finite.
template <class T>
GS_HD void adam_update(T& p, T& m, T& v, T gradient, const AdamStep<T>& s,
                       const AdamGains<T>& gains = AdamGains<T>::of_one()) {
    const T g = gs_clamp(gradient, T(-kLargestGradient), T(kLargestGradient));
    // Written as v + (1-beta)(g^2 - v), since 1-beta is exact to half an ulp; beta rounded to float would be off by
    // 1e-5 of 1-beta.
    m = gs_fma(gains.first, g - m, m);
    v = gs_fma(gains.second, g * g - v, v);
    p = p - s.step_size * m * reciprocal(gs_sqrt(v) * s.inverse_sqrt_bias + T(kAdamEpsilon));
}

}  // namespace gs
