// SPDX-License-Identifier: Apache-2.0
// How much of a picture an ellipsoid covers.
#pragma once

#include <array>
#include <cmath>

namespace gs {

/// Returns the mean area of an ellipsoid's projections, up to a factor (Thomsen's approximation of its surface).
inline double mean_area(const std::array<double, 3>& s) {
    const auto pair = [&](int i, int j) { return std::pow(s[std::size_t(i)] * s[std::size_t(j)], 1.6); };
    return std::pow(pair(0, 1) + pair(0, 2) + pair(1, 2), 1 / 1.6);
}

}  // namespace gs
