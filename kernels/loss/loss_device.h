// SPDX-License-Identifier: Apache-2.0
// The L1 term and the SSIM of one pixel, with derivatives (docs/math/optimization.md#loss).
#pragma once

#include <cmath>

#include "kernels/base/portable.h"

namespace gs {

/// Half width of the SSIM window, which has 11 taps and sigma 1.5.
inline constexpr int kSsimRadius = 5;
inline constexpr double kSsimC1 = 0.01 * 0.01, kSsimC2 = 0.03 * 0.03;

/// The taps g[0] (centre) .. g[5], normalised over all 11.
template <class T> struct SsimTaps {
    T g[kSsimRadius + 1];
    SsimTaps() {
        double sum = 0;
        for (int i = -kSsimRadius; i <= kSsimRadius; ++i) sum += std::exp(-i * i / 4.5);
        for (int i = 0; i <= kSsimRadius; ++i) g[i] = T(std::exp(-i * i / 4.5) / sum);
    }
};

/// The L1 term of a pixel and its derivative.
template <class T> struct L1Pixel { T value, slope; };

/// Computes |d| and its derivative, which is 0 at d = 0. It has no branches, so that loops over it vectorise.
template <class T> GS_HD L1Pixel<T> l1_pixel(T d) {
    const T sign = (d > T(0) ? T(1) : T(0)) - (d < T(0) ? T(1) : T(0));
    return {d * sign, sign};
}

/// SSIM and its derivatives p, q, r with respect to the filtered x (total, through mu1), x^2 and x y.
template <class T> struct SsimPixel { T ssim, p, q, r; };

/// Computes the SSIM of a pixel. x is the render, y the target; mx = G*x, exx = G*x^2, and so on. It has no branches,
/// so that loops over it vectorise.
template <class T> GS_HD SsimPixel<T> ssim_pixel(T mx, T my, T exx, T eyy, T exy) {
    const T raw_x = exx - mx * mx, raw_y = eyy - my * my;
    // Variances are >= 0 except for rounding. A clamped variance passes no derivative.
    const T var_x = raw_x > T(0) ? raw_x : T(0), var_y = raw_y > T(0) ? raw_y : T(0);
    const T a = mx * mx + my * my + T(kSsimC1), b = var_x + var_y + T(kSsimC2);
    const T c = T(2) * mx * my + T(kSsimC1), d = T(2) * (exy - mx * my) + T(kSsimC2);
    const T ia = T(1) / a, ib = T(1) / b, s = c * d * ia * ib;
    // |SSIM| is <= 1 except for rounding. A clamped SSIM passes no derivative either.
    const T pass = s <= T(1) && s >= T(-1) ? T(1) : T(0);
    const T dq = -s * ib * pass;
    const T open = raw_x > T(0) ? T(1) : T(0);
    SsimPixel<T> out;
    out.ssim = s > T(1) ? T(1) : (s < T(-1) ? T(-1) : s);
    out.q = dq * open;
    out.r = T(2) * c * ia * ib * pass;
    out.p = (T(2) * my * (d - c) * ia * ib - T(2) * mx * s * ia) * pass - T(2) * mx * out.q;
    return out;
}

}  // namespace gs
