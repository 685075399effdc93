// SPDX-License-Identifier: Apache-2.0
// The median of a list of numbers.
#pragma once

#include <algorithm>
#include <vector>

namespace gs {

/// The upper one of two in the middle. `values` is not empty.
inline double median(std::vector<double> values) {
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace gs
