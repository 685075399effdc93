// SPDX-License-Identifier: Apache-2.0
// A scalar whose every operation is off by a random part of what single precision may be off by: Monte Carlo arithmetic
// (Parker, Monte Carlo Arithmetic, 1997; Vignes, A stochastic arithmetic for reliable scientific computation, 1993).
//
// Several evaluations of the same formula with different noise spread like fp32 evaluations in different orders do.
// Unlike running bounds (rounding.h) the spread knows that errors partly cancel: sums over thousands of pixels of both
// signs, as gradients are, have worst-case bounds larger than themselves, and an actual error of 1e-6.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "tests/gpu/rounding.h"

namespace gs::test {

/// The noise of this thread. It starts anew for each item of work, so that results do not depend on the thread.
class Noise {
  public:
    static void start(std::uint64_t sample, std::uint64_t item) {
        state() = (sample * 0x9e3779b97f4a7c15 + item * 0xbf58476d1ce4e5b9) | 1;
    }
    /// Returns a uniform number in [-1, 1].
    static double next() {
        std::uint64_t& s = state();
        s ^= s >> 12, s ^= s << 25, s ^= s >> 27;
        return double(std::int64_t(s * 0x2545f4914f6cdd1d)) * 0x1p-63;
    }

  private:
    static std::uint64_t& state() {
        static thread_local std::uint64_t s = 1;
        return s;
    }
};

struct Noisy {
    double v;

    Noisy() = default;
    explicit Noisy(double x) : v(double(float(x))) {}  ///< constants are those of float
    /// Returns x with the noise of an operation of `units` roundings, as in rounding.h.
    static Noisy of(double x, double units) {
        Noisy r;
        r.v = x * (1 + units * kRoundoff * Noise::next());
        return r;
    }
    explicit operator int() const { return int(v); }

    Noisy operator-() const {
        Noisy r;
        r.v = -v;
        return r;
    }
    friend Noisy operator+(Noisy a, Noisy b) { return of(a.v + b.v, 1); }
    friend Noisy operator-(Noisy a, Noisy b) { return of(a.v - b.v, 1); }
    friend Noisy operator*(Noisy a, Noisy b) { return of(a.v * b.v, 1); }
    friend Noisy operator/(Noisy a, Noisy b) { return of(a.v / b.v, 4); }
    friend bool operator<(Noisy a, Noisy b) { return a.v < b.v; }
    friend bool operator>(Noisy a, Noisy b) { return a.v > b.v; }
    friend bool operator<=(Noisy a, Noisy b) { return a.v <= b.v; }
    friend bool operator>=(Noisy a, Noisy b) { return a.v >= b.v; }
    friend bool operator==(Noisy a, Noisy b) { return a.v == b.v; }
};

inline Noisy lane_max(Noisy a, Noisy b) { return a.v > b.v ? a : b; }
inline Noisy lane_min(Noisy a, Noisy b) { return a.v < b.v ? a : b; }
inline bool at_least(Noisy a, Noisy b) { return a.v >= b.v; }
inline Noisy gs_abs(Noisy a) { return a.v < 0 ? -a : a; }
inline Noisy gs_fma(Noisy a, Noisy b, Noisy c) { return Noisy::of(a.v * b.v + c.v, 1); }
inline Noisy reciprocal(Noisy x) { return Noisy::of(1 / x.v, 2); }
inline Noisy gs_exp(Noisy x) { return Noisy::of(std::exp(x.v), 4); }
inline Noisy exp2_nonpositive(Noisy x) { return Noisy::of(std::exp2(std::min(x.v, 0.0)), 4); }
inline void gs_sincos(Noisy x, Noisy& s, Noisy& c) { s = Noisy::of(std::sin(x.v), 4), c = Noisy::of(std::cos(x.v), 4); }
inline Noisy gs_atan2(Noisy y, Noisy x) { return Noisy::of(std::atan2(y.v, x.v), 8); }
inline Noisy gs_log(Noisy x) { return Noisy::of(std::log(x.v), 4); }
inline Noisy gs_sqrt(Noisy x) { return Noisy::of(std::sqrt(x.v), 6); }
inline Noisy gs_log1p(Noisy x) { return Noisy::of(std::log1p(x.v), 4); }
inline Noisy gs_floor(Noisy x) { return Noisy(std::floor(x.v)); }
inline Noisy gs_ceil(Noisy x) { return Noisy(std::ceil(x.v)); }

}  // namespace gs::test
