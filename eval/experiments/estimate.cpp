// SPDX-License-Identifier: Apache-2.0
// Curves through measured losses.
#include "eval/experiments/estimate.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace gs {

// The curves, and how far they are off: docs/lab/limits.md#what-the-plan-estimates.

double loss_of_length(double rounds) { return 0.8 * std::pow(70 / rounds, 1.3); }

double loss_of_count(std::int64_t count, std::int64_t most) {
    const double halvings = std::max(0.0, std::log2(double(most) / double(count)));
    return (0.15 + 0.13 * halvings) * halvings;
}

std::string about(double loss) {
    constexpr double kMost = 10;  // farther than any measurement goes
    if (loss < 0.1) return "less than 0.1 dB";
    return loss > kMost ? fmt::format("more than {:g} dB", kMost) : fmt::format("about {:.1f} dB", loss);
}

}  // namespace gs
