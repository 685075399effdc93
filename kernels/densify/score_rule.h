// SPDX-License-Identifier: Apache-2.0
// The rule of pruning by score (docs/math/densification.md#pruning-by-score), the same on every backend.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace gs {

/// Returns the rank of the threshold among n scores, where rank 1 is the lowest.
inline std::int64_t score_rank(double ratio, std::int64_t n) {
    return std::clamp<std::int64_t>(std::int64_t(std::floor(ratio * double(n - 1))) + 1, 1, n);
}

/// Returns the number of rows that always stay, a hundredth. Where no view shows anything all scores are 0, and all
/// rows would go.
inline std::int64_t least_kept(std::int64_t n) { return (n + 99) / 100; }

}  // namespace gs
