// SPDX-License-Identifier: Apache-2.0
// The learning-rate schedules of the paper (table "learning rates"; docs/math/optimization.md#schedules), for the host.
#pragma once

#include <algorithm>
#include <cmath>

namespace gs {

/// One learning rate over time. `at(it)` returns the absolute rate of the 1-based iteration `it`.
struct Schedule {
    enum class Kind { kConstant, kLogLinear, kCosine, kWarmUp };
    Kind kind = Kind::kConstant;
    double initial = 0;       ///< rate at the start
    double final_factor = 1;  ///< kLogLinear, kCosine: last rate / initial rate
    double start = 0;         ///< kCosine: first iteration of the decay
    double end = 30000;       ///< iteration at which the last rate is reached
    double before = 1;        ///< kCosine: factor on `initial` before `start`
    bool zero_after = false;  ///< kCosine: the rate is 0 after `end` (delayed cosine of spherical Voronoi)

    double at(double it) const {
        switch (kind) {
            case Kind::kConstant:
                return initial;
            case Kind::kLogLinear: {
                const double t = std::clamp(it / end, 0.0, 1.0);
                return initial > 0 ? initial * std::pow(final_factor, t) : 0.0;
            }
            case Kind::kCosine: {
                if (it < start) return before * initial;
                if (zero_after && it > end) return 0;
                const double t = std::clamp((it - start) / (end - start), 0.0, 1.0);
                const double last = final_factor * initial;
                return last + 0.5 * (initial - last) * (1 + std::cos(M_PI * t));
            }
            case Kind::kWarmUp: {
                // The rate rises over 3000 iterations from a factor of 1e-8, and falls log-linearly to a tenth over
                // 30000.
                const double w =
                    it < 3000 ? 1e-8 + (1 - 1e-8) * std::sin(0.5 * M_PI * std::clamp(it / 3000, 0.0, 1.0)) : 1.0;
                return w * initial * std::pow(0.1, std::clamp(it / 30000, 0.0, 1.0));
            }
        }
        return initial;
    }

    static Schedule constant(double rate) { return {Kind::kConstant, rate}; }
    static Schedule log_linear(double first, double last, double end) {
        return {Kind::kLogLinear, first, first > 0 ? last / first : 1, 0, end};
    }
    static Schedule cosine(double rate, double start, double end, double final_factor, double before,
                           bool zero_after = false) {
        return {Kind::kCosine, rate, final_factor, start, end, before, zero_after};
    }
    static Schedule warm_up(double rate) { return {Kind::kWarmUp, rate}; }
};

}  // namespace gs
