// SPDX-License-Identifier: Apache-2.0
// Row operations on the host: gather, pruning (also by score), and Morton order.
#include <algorithm>
#include <numeric>

#include "kernels/base/parallel.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/residual_handles.h"
#include "kernels/densify/rows_device.h"

namespace gs {
namespace {

template <class T> void gather(std::vector<T>& data, int width, const std::vector<std::uint32_t>& order) {
    if (data.empty()) return;
    std::vector<T> out;
    out.reserve(std::max(data.capacity(), order.size() * width));  // keeps the memory reserved for growth
    out.resize(order.size() * width);
    const std::int64_t n = static_cast<std::int64_t>(order.size());
    parallel_for(num_parts(n), [&](std::int64_t part) {
        for (std::int64_t k = part * kPartSize, end = std::min(n, k + kPartSize); k < end; ++k)
            std::copy_n(&data[std::size_t(order[k]) * width], width, &out[std::size_t(k) * width]);
    });
    data.swap(out);
}

template <class Keep> std::int64_t keep_if(Gaussians& state, Keep&& keep) {
    std::vector<std::uint32_t> order;
    for (std::int64_t i = 0; i < state.count; ++i)
        if (keep(i)) order.push_back(static_cast<std::uint32_t>(i));
    const std::int64_t removed = state.count - static_cast<std::int64_t>(order.size());
    if (removed) gather_rows(state, order);
    return removed;
}

}  // namespace

void gather_rows(Gaussians& state, const std::vector<std::uint32_t>& order) {
    ResidualHandles residuals(state);
    for (auto& group : state.groups) {
        gather(group.param, group.width, order);
        gather(group.m, group.width, order);
        gather(group.v, group.width, order);
    }
    gather(state.gradient_sum, 1, order);
    gather(state.gradient_count, 1, order);
    gather(state.last_step, 1, order);
    state.count = static_cast<std::int64_t>(order.size());
    residuals.resolve();
}

std::int64_t remove_nonfinite(Gaussians& state, std::int64_t by_group[kNumGroups]) {
    std::fill_n(by_group, kNumGroups, 0);
    return keep_if(state, [&](std::int64_t i) {
        bool keep = true;
        for (int g = 0; g < kNumGroups; ++g) {
            if (i >= state.num_rows(Group(g))) continue;
            const auto& group = state.groups[g];
            const float* row = group.param.data() + i * group.width;
            const bool good =
                std::all_of(row, row + group.width, [g](float x) { return in_range(x, kLargestParameter[g]); });
            if (!good) ++by_group[g];
            keep = keep && good;
        }
        return keep;
    });
}

std::int64_t remove_invisible(Gaussians& state) {
    const auto opacities = ShownOpacities::of(state);
    return keep_if(state,
                   [&](std::int64_t i) { return is_visible(opacities(i), &state[Group::kRotation].param[4 * i]); });
}

std::vector<std::uint32_t> morton_order(const Gaussians& state) {
    const std::vector<float>& means = state[Group::kMean].param;
    MeanBounds bounds;
    for (std::int64_t i = 0; i < state.count; ++i) bounds.add(&means[3 * i]);
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(state.count);
    for (std::int64_t i = 0; i < state.count; ++i)
        keys[i] = {morton_code(&means[3 * i], bounds), static_cast<std::uint32_t>(i)};
    std::sort(keys.begin(), keys.end());
    std::vector<std::uint32_t> order(state.count);
    for (std::int64_t i = 0; i < state.count; ++i) order[i] = keys[i].second;
    return order;
}

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
