// SPDX-License-Identifier: Apache-2.0
// The median of a list of numbers.
#pragma once

#include <algorithm>
#include <vector>

namespace gs {

/// Returns the median; of an even number of values the larger of the two middle ones. `values` must not be empty.
inline double median(std::vector<double> values) {
    const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace gs
