// SPDX-License-Identifier: Apache-2.0
// Grows, relocates and prunes Gaussians on the host (docs/math/densification.md). The rows of all groups move together.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "kernels/requests.h"

namespace gs {

// The rule for pruning by score (docs/math/densification.md#pruning-by-score), the same on every backend.

/// Returns the rank of the threshold among n scores, where rank 1 is the lowest.
inline std::int64_t score_rank(double ratio, std::int64_t n) {
    return std::clamp<std::int64_t>(std::int64_t(std::floor(ratio * double(n - 1))) + 1, 1, n);
}

/// Returns the number of rows that always stay, a hundredth. If no view shows anything, all scores are 0, and otherwise
/// all rows would be removed.
inline std::int64_t least_kept(std::int64_t n) { return (n + 99) / 100; }

/// Makes old row order[k] the new row k, and removes rows that are not in `order`. Moments and the ADC statistic move
/// along. In a mixed model the rows with a residual come first, each kind in the order of `order`.
void gather_rows(Gaussians& state, const std::vector<std::uint32_t>& order);

/// Relocates dead Gaussians onto living ones and grows by the factor `growth` up to the cap
/// (docs/math/densification.md#mcmc). Drops the ADC statistic.
DensifyStats mcmc_densify(Gaussians& state, const McmcParams& params, std::int64_t iteration, std::uint64_t seed);

/// Throws the error of a densification that removed all of `before` Gaussians.
[[noreturn]] void throw_nothing_left(const AdcParams& params, std::int64_t iteration, std::int64_t before);

/// Clones, splits and prunes by the gathered statistic, which is reset (docs/math/densification.md#adc). Throws
/// UsageError if no Gaussian is left, unless that is allowed.
DensifyStats adc_densify(Gaussians& state, const AdcParams& params, std::int64_t iteration, std::uint64_t seed);

/// Lowers opacities to 0.01 and zeroes their moments.
void adc_reset_opacity(Gaussians& state);

/// Removes Gaussians with a parameter that is not finite or beyond kLargestParameter (rows_device.h), and counts the
/// broken rows per group. Returns the number of removed Gaussians.
std::int64_t remove_nonfinite(Gaussians& state, std::int64_t by_group[kNumGroups]);

/// Removes Gaussians that no view can show: opacity < 1/255 or |q|^2 < 1e-8. Returns their number.
std::int64_t remove_invisible(Gaussians& state);

/// Returns the rows, ascending, that stay after removing the share `ratio` with the lowest scores (score_rank()).
std::vector<std::uint32_t> rows_of_highest_scores(const std::vector<float>& scores, double ratio);

/// Returns the rows in the order of the Morton codes of their means, 21 bits per axis
/// (docs/math/densification.md#morton-order).
std::vector<std::uint32_t> morton_order(const Gaussians& state);

}  // namespace gs
