// SPDX-License-Identifier: Apache-2.0
// Pruning by score on the host.
#include <algorithm>
#include <numeric>

#include "kernels/densify/densify.h"
#include "kernels/densify/score_rule.h"

namespace gs {

std::vector<std::uint32_t> rows_of_highest_scores(const std::vector<float>& scores, double ratio) {
    const auto n = std::int64_t(scores.size());
    std::vector<std::uint32_t> order(n);  // by falling score
    if (n == 0) return order;
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return scores[a] > scores[b]; });
    const float threshold = scores[order[n - score_rank(ratio, n)]];
    const auto above =
        std::partition_point(order.begin(), order.end(), [&](std::uint32_t i) { return scores[i] > threshold; });
    order.resize(std::max<std::int64_t>(above - order.begin(), least_kept(n)));
    std::sort(order.begin(), order.end());
    return order;
}

std::int64_t remove_lowest_scores(Gaussians& state, const std::vector<float>& scores, double ratio) {
    const std::int64_t before = state.count;
    const std::vector<std::uint32_t> rows = rows_of_highest_scores(scores, ratio);
    if (std::int64_t(rows.size()) < before) gather_rows(state, rows);
    return before - state.count;
}

}  // namespace gs
