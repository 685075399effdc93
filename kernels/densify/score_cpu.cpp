// SPDX-License-Identifier: Apache-2.0
// Pruning by score on the host.
#include <algorithm>
#include <numeric>

#include "kernels/densify/densify.h"
#include "kernels/densify/score_rule.h"

namespace gs {

std::int64_t remove_lowest_scores(Gaussians& state, const std::vector<float>& scores, double ratio) {
    const std::int64_t n = state.count;
    if (n == 0) return 0;
    std::vector<std::uint32_t> order(n);  // by falling score
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return scores[a] > scores[b]; });
    const float threshold = scores[order[n - score_rank(ratio, n)]];
    const auto above =
        std::partition_point(order.begin(), order.end(), [&](std::uint32_t i) { return scores[i] > threshold; });
    order.resize(std::max<std::int64_t>(above - order.begin(), least_kept(n)));
    if (std::int64_t(order.size()) == n) return 0;
    std::sort(order.begin(), order.end());
    gather_rows(state, order);
    return n - state.count;
}

}  // namespace gs
