// SPDX-License-Identifier: Apache-2.0
// The opacity and scale of Gaussians that share one Gaussian's place (docs/math/densification.md#relocation).
#pragma once

#include "kernels/base/portable.h"

namespace gs {

/// The largest number of copies at one place that is accounted for (the limit of the reference's table).
inline constexpr int kMaxRelocationCopies = 50;

/// The opacity and scale of each of n copies.
struct Relocated {
    double opacity;       ///< opacity of each copy, not clamped
    double scale_factor;  ///< factor on linear scales
};

/// Returns the values of n copies that together look like one Gaussian of this opacity (MCMC paper Eq. 9; the
/// hockey-stick identity collapses the double sum to one). It uses double, because in float the alternating sum loses
/// up to 4e-4 at n = 50.
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

}  // namespace gs
