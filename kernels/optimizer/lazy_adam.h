// SPDX-License-Identifier: Apache-2.0
// Lazy Adam for the residuals of Gaussians that were out of view, on the device, if all Gaussians take each step. The
// missed steps of a residual have gradient zero, and are all taken at once when the Gaussian is next seen. (Geometry is
// needed in every step, so it is not deferred.)
//
// Without a gradient, k steps of Adam from (p, m, v) after step s end at m beta1^k, v beta2^k and
//     p - sum_j a_{s+j} m beta1^j / (sqrt(v beta2^j) b_{s+j} + eps),  j = 1..k,
// with the step size a and bias factor b of each step. If sqrt(v) >> eps, the sum is m / sqrt(v) times
// which does not depend on the Gaussian. For the step t = s + k + 1 about to be taken, T_t(k) = S_{t-1-k}(k) obeys
//     T_t(k) = T_{t-1}(k - 1) + (a_{t-1} / b_{t-1}) q^k,  T(0) = 0.
// So one addition per entry and step maintains a table for all k up to a limit. eps matters only if gradients were
// about 1e-14, and enters as eps / b of the last step.
#pragma once

#include <array>

#include "kernels/state/adam_device.h"

namespace gs {

/// Largest number of steps by which a residual may lag. Before one lags further, all residuals are brought up to date.
inline constexpr int kMaxLag = 127;

/// The values T_t(k) by k. The table is plain data, passed to kernels by value.
struct LazyTable {
    float sums[kMaxLag + 1];
    float epsilon;  ///< eps / b
};

/// The table of the step about to be taken.
class LazySchedule {
  public:
    LazyTable table() const {
        LazyTable t;
        for (int k = 0; k <= kMaxLag; ++k) t.sums[k] = float(sums_[k]);
        t.epsilon = float(epsilon_);
        return t;
    }
    /// Advances the table after step t, which had the rate `rate`.
    void advance(double rate, std::int64_t t) {
        const double inverse_b = std::sqrt(1 - std::pow(kAdamBeta2, double(t))),
                     r = rate / (1 - std::pow(kAdamBeta1, double(t))) * inverse_b;
        epsilon_ = kAdamEpsilon * inverse_b;
        const double q = kAdamBeta1 / std::sqrt(kAdamBeta2);
        double power = 1, before = sums_[0];
        for (int k = 1; k <= kMaxLag; ++k) {
            power *= q;
            const double old = sums_[k];
            sums_[k] = before + r * power;
            before = old;
        }
    }

  private:
    std::array<double, kMaxLag + 1> sums_{};
    double epsilon_ = kAdamEpsilon;
};

/// Returns the parameter after the missed steps; `sum` is T_t(k) of the row.
GS_HD float catch_up_parameter(float p, float m, float v, float sum, float epsilon) {
    return p - sum * m * reciprocal(gs_sqrt(v) + epsilon);
}

/// Decay factors of the moments after `lag` missed steps.
GS_HD float first_moment_decay(int lag) { return ::exp2f(float(lag) * -0.15200309344504995f); }  // log2 0.9
GS_HD float second_moment_decay(int lag) { return second_moment_decay(float(lag)); }

}  // namespace gs
