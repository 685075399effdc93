// SPDX-License-Identifier: Apache-2.0
// Adaptive density control on host arrays: it clones, splits and prunes (docs/math/densification.md#adc).
#include <algorithm>

#include "kernels/base/error.h"
#include "kernels/densify/adc_device.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/residual_handles.h"

namespace gs {
namespace {

void append_copy(Gaussians& s, std::int64_t parent) {
    for (auto& group : s.groups) {
        group.param.resize(group.param.size() + group.width);
        std::copy_n(group.param.begin() + parent * group.width, group.width, group.param.end() - group.width);
        group.m.resize(group.m.size() + group.width, 0.0f);
        group.v.resize(group.v.size() + group.width, 0.0f);
    }
    if (!s.last_step.empty()) s.last_step.push_back(s.last_step[parent]);
    ++s.count;
}

void split(Gaussians& s, std::int64_t parent, std::int64_t iteration, std::uint64_t seed) {
    for (std::uint32_t child = 0; child < 2; ++child) {
        append_copy(s, parent);
        const std::int64_t row = s.count - 1;
        make_split_child(&s[Group::kMean].param[3 * row], &s[Group::kScale].param[3 * row],
                         &s[Group::kRotation].param[4 * row], std::uint32_t(parent), child, iteration, seed);
    }
}

}  // namespace

void throw_nothing_left(const AdcParams& params, std::int64_t iteration, std::int64_t before) {
    throw UsageError("iteration " + std::to_string(iteration) + ": densification pruned all " + std::to_string(before) +
                     " Gaussians (opacity below " + std::to_string(params.min_opacity) +
                     " or scale above 0.1 of the scene extent): lower opacity-lr or scaling-lr, and look whether the "
                     "images show anything");
}

DensifyStats adc_densify(Gaussians& s, const AdcParams& params, std::int64_t iteration, std::uint64_t seed) {
    DensifyStats stats;
    const AdcRule rule = AdcRule::of(params);
    ResidualHandles residuals(s);
    const std::int64_t before = s.count;
    const auto max_scale = [&](std::int64_t i) { return max_log_scale(&s[Group::kScale].param[3 * i]); };
    s.gradient_sum.resize(before, 0.0f);  // without a statistic nothing grows
    s.gradient_count.resize(before, 0.0f);
    std::vector<std::pair<float, std::uint32_t>> growers;  // (rank, index)
    for (std::int64_t i = 0; i < before; ++i)
        if (rule.grows(s.gradient_sum[i], s.gradient_count[i]))
            growers.emplace_back(adc_rank(s.gradient_sum[i], s.gradient_count[i]), std::uint32_t(i));
    // Each clone or split adds one Gaussian. At the cap the strongest gradients grow first.
    const std::int64_t room =
        params.cap > 0 ? std::max<std::int64_t>(0, params.cap - before) : std::int64_t(growers.size());
    if (std::int64_t(growers.size()) > room) {
        std::sort(growers.begin(), growers.end());
        growers.resize(room);
        std::sort(growers.begin(), growers.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    }
    std::vector<char> remove(before, 0);
    for (const auto& [gradient, i] : growers)
        if (rule.is_small(max_scale(i))) append_copy(s, i), ++stats.cloned;
    for (const auto& [gradient, i] : growers)
        if (!rule.is_small(max_scale(i))) split(s, i, iteration, seed), remove[i] = 1, ++stats.split;

    const auto shown = ShownOpacities::of(s);
    std::vector<std::uint32_t> keep;
    for (std::int64_t i = 0; i < s.count; ++i) {
        if (i < before && remove[i]) continue;
        if (rule.is_kept(shown(i), &s[Group::kRotation].param[4 * i], max_scale(i)))
            keep.push_back(std::uint32_t(i));
        else
            ++stats.pruned;
    }
    if (keep.empty() && !params.may_remove_all) throw_nothing_left(params, iteration, s.count);
    s.gradient_sum.clear();  // the statistic restarts
    s.gradient_count.clear();
    gather_rows(s, keep);
    residuals.resolve();
    stats.count = s.count;
    return stats;
}

void adc_reset_opacity(Gaussians& s) {
    auto& group = s[Group::kOpacity];
    for (float& x : group.param) x = reset_raw_opacity(x);
    std::fill(group.m.begin(), group.m.end(), 0.0f);
    std::fill(group.v.begin(), group.v.end(), 0.0f);
}

}  // namespace gs
