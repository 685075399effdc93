// SPDX-License-Identifier: Apache-2.0
// A scalar that knows how far single precision may be off: value in double, and a bound of the error that any fp32
// evaluation of the same formula has (running error analysis, Higham, Accuracy and Stability of Numerical Algorithms,
// section 3.3).
//
// The GS_HD templates of the kernels run on it unchanged, so the bound is that of the very formulas under test, with
// the condition of each cancellation, exponential and quotient at the values at hand. Every operation adds
//   u |result|        for + - * fma, which are rounded correctly (u = 2^-24); contracting two into an fma only saves
//   one; 4 u |result|      for what the device may evaluate to 2 ulp: division, exp, ex2.approx, log; 6 u |result| for
//   sqrt.approx (3 ulp);  2 u |result| for rcp.approx (1 ulp); 2^-126            for results flushed to zero,
// to what the operands' errors are worth in the result. Constants that float cannot hold start with their rounding.
#pragma once

#include <algorithm>
#include <cmath>

namespace gs::test {

inline constexpr double kRoundoff = 0x1p-24, kFlushed = 0x1p-126;

struct Rounded {
    double v, e;

    Rounded() = default;
    explicit Rounded(double x) : v(x), e(std::abs(x - double(float(x)))) {}
    Rounded(double value, double error) : v(value), e(error) {}
    static Rounded of(double v, double propagated, double units) {
        return {v, propagated + units * kRoundoff * std::abs(v) + kFlushed};
    }

    explicit operator int() const { return int(v); }

    Rounded operator-() const { return {-v, e}; }
    friend Rounded operator+(Rounded a, Rounded b) { return of(a.v + b.v, a.e + b.e, 1); }
    friend Rounded operator-(Rounded a, Rounded b) { return of(a.v - b.v, a.e + b.e, 1); }
    friend Rounded operator*(Rounded a, Rounded b) {
        return of(a.v * b.v, std::abs(a.v) * b.e + std::abs(b.v) * a.e + a.e * b.e, 1);
    }
    friend Rounded operator/(Rounded a, Rounded b) {
        const double q = a.v / b.v, least = std::abs(b.v) - b.e;
        return of(q, least > 0 ? (a.e + std::abs(q) * b.e) / least : INFINITY, 4);
    }
    // Comparisons are those of the values: whoever takes a decision looks after the other outcome.
    friend bool operator<(Rounded a, Rounded b) { return a.v < b.v; }
    friend bool operator>(Rounded a, Rounded b) { return a.v > b.v; }
    friend bool operator<=(Rounded a, Rounded b) { return a.v <= b.v; }
    friend bool operator>=(Rounded a, Rounded b) { return a.v >= b.v; }
    friend bool operator==(Rounded a, Rounded b) { return a.v == b.v; }
};

// Maximum and minimum move at most as far as the operand that moves farther: no decision is taken.
inline Rounded gs_max(Rounded a, Rounded b) {
    const Rounded& larger = a.v > b.v ? a : b;
    return {larger.v, std::abs(a.v - b.v) > a.e + b.e ? larger.e : std::max(a.e, b.e)};
}
inline Rounded gs_min(Rounded a, Rounded b) { return -gs_max(-a, -b); }
inline Rounded gs_clamp(Rounded x, Rounded low, Rounded high) { return gs_min(gs_max(x, low), high); }
inline Rounded lane_max(Rounded a, Rounded b) { return gs_max(a, b); }
inline Rounded lane_min(Rounded a, Rounded b) { return gs_min(a, b); }
inline bool at_least(Rounded a, Rounded b) { return a.v >= b.v; }
inline Rounded gs_abs(Rounded a) { return {std::abs(a.v), a.e}; }
inline Rounded gs_fma(Rounded a, Rounded b, Rounded c) { return a * b + c; }
inline Rounded reciprocal(Rounded x) { return Rounded(1.0, 0.0) / x; }
inline Rounded gs_exp(Rounded x) {
    const double v = std::exp(x.v);
    return Rounded::of(v, v * std::expm1(x.e), 4);
}
inline Rounded exp2_nonpositive(Rounded x) {
    const double v = std::exp2(std::min(x.v, 0.0)), propagated = v * (std::exp2(x.e) - 1);
    return Rounded::of(v, std::min(propagated, 1.0), 4);  // neither result leaves [0, 1]
}
inline Rounded gs_atan2(Rounded y, Rounded x) {
    const double r = std::hypot(x.v, y.v);
    return Rounded::of(std::atan2(y.v, x.v), r > 0 ? (x.e + y.e) / r : INFINITY, 8);
}
inline Rounded gs_log(Rounded x) {
    const double least = x.v - x.e;
    return Rounded::of(std::log(x.v), least > 0 ? x.e / least : INFINITY, 4);
}
inline Rounded gs_sqrt(Rounded x) {
    const double v = std::sqrt(std::max(x.v, 0.0));
    return Rounded::of(v, v - std::sqrt(std::max(x.v - x.e, 0.0)) + (x.v < x.e ? std::sqrt(x.e) : 0.0), 6);
}
inline Rounded gs_log1p(Rounded x) {
    return Rounded::of(std::log1p(x.v), 1 + x.v > x.e ? x.e / (1 + x.v - x.e) : INFINITY, 4);
}
// Only bounds of pixel rectangles are rounded to integers, and those never decide about a fragment.
inline Rounded gs_floor(Rounded x) { return {std::floor(x.v), 0}; }
inline Rounded gs_ceil(Rounded x) { return {std::ceil(x.v), 0}; }

}  // namespace gs::test
