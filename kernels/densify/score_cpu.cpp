// SPDX-License-Identifier: Apache-2.0
// Which Gaussians pruning by score leaves.
#include <algorithm>
#include <numeric>

#include "kernels/densify/densify.h"
#include "kernels/densify/score_rule.h"

namespace gs {

std::vector<std::uint32_t> rows_of_highest_scores(const std::vector<float>& scores, double ratio) {
    const auto n = std::int64_t(scores.size());
    std::vector<std::uint32_t> kept;
    if (n == 0) return kept;
    std::vector<float> by_score = scores;
    const auto at_cut = by_score.begin() + (score_rank(ratio, n) - 1);
    std::nth_element(by_score.begin(), at_cut, by_score.end());
    for (std::int64_t i = 0; i < n; ++i)
        if (scores[i] > *at_cut) kept.push_back(std::uint32_t(i));
    const std::int64_t least = least_kept(n);
    if (std::int64_t(kept.size()) >= least) return kept;
    kept.resize(n);
    std::iota(kept.begin(), kept.end(), 0u);
    std::stable_sort(kept.begin(), kept.end(), [&](std::uint32_t a, std::uint32_t b) { return scores[a] > scores[b]; });
    kept.resize(least);
    std::sort(kept.begin(), kept.end());
    return kept;
}

}  // namespace gs
