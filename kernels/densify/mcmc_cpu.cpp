// SPDX-License-Identifier: Apache-2.0
// MCMC densification on host arrays.
#include <algorithm>
#include <numeric>

#include "kernels/densify/densify.h"
#include "kernels/densify/mcmc_device.h"
#include "kernels/densify/residual_handles.h"

namespace gs {
namespace {

/// Makes row to[k] a copy of the row selected by draw k. Drawn rows get the opacity and scale of their share and lose
/// their moments. The moments of the rows in `to` do not change. The rows in `to` must have weight 0.
void fill_rows(Gaussians& s, const std::vector<std::uint64_t>& prefix_sums, const std::vector<std::uint32_t>& to,
               float min_opacity, RngStream stream, std::int64_t iteration, std::uint64_t seed) {
    const auto n = static_cast<std::int64_t>(prefix_sums.size());
    std::vector<std::uint32_t> from(to.size());
    std::vector<std::int32_t> copies(n, 0);
    for (std::size_t k = 0; k < to.size(); ++k)
        ++copies[from[k] = draw_row(prefix_sums.data(), n, seed, stream, iteration, std::uint32_t(k))];
    for (std::int64_t j = 0; j < n; ++j) {
        if (copies[j] == 0) continue;
        float& raw_opacity = s[Group::kOpacity].param[j];
        const McmcShare share = mcmc_share(raw_opacity, copies[j], min_opacity);
        raw_opacity = share.raw_opacity;
        for (int c = 0; c < 3; ++c) s[Group::kScale].param[3 * j + c] += share.log_scale_shift;
        for (auto& group : s.groups)
            for (auto* moment : {&group.m, &group.v}) std::fill_n(moment->begin() + j * group.width, group.width, 0.0f);
    }
    for (auto& group : s.groups)
        for (std::size_t k = 0; k < to.size(); ++k)
            std::copy_n(group.param.begin() + std::ptrdiff_t(from[k]) * group.width, group.width,
                        group.param.begin() + std::ptrdiff_t(to[k]) * group.width);
    for (std::size_t k = 0; k < to.size() && !s.last_step.empty(); ++k) s.last_step[to[k]] = s.last_step[from[k]];
}

}  // namespace

DensifyStats mcmc_densify(Gaussians& s, const McmcParams& params, std::int64_t iteration, std::uint64_t seed) {
    DensifyStats stats;
    ResidualHandles residuals(s);
    const std::int64_t n = s.count;
    const float* raw_opacities = s[Group::kOpacity].param.data();
    const auto shown = ShownOpacities::of(s);
    const float dead_logit = logit(params.min_opacity);
    std::vector<std::uint64_t> sums(n);
    std::vector<std::uint32_t> to;
    std::uint64_t total = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        const bool dead = is_dead(shown(i), &s[Group::kRotation].param[4 * i], dead_logit);
        if (dead) to.push_back(static_cast<std::uint32_t>(i));
        sums[i] = total += dead ? 0 : sampling_weight(raw_opacities[i]);
    }
    if (total > 0) {  // otherwise no row is alive, and nothing moves
        fill_rows(s, sums, to, params.min_opacity, RngStream::kRelocate, iteration, seed);
        stats.relocated = static_cast<std::int64_t>(to.size());
    }

    total = 0;
    for (std::int64_t i = 0; i < n; ++i) {
        const double missed = s.last_step.empty() ? 0 : double(s.step) - s.last_step[i];
        sums[i] = total += params.by_gradient ? gradient_weight(raw_opacities[i], &s[Group::kBase].v[3 * i], missed)
                                              : sampling_weight(raw_opacities[i]);
    }
    const std::int64_t target = mcmc_target(n, params);
    if (target > n && total > 0) {
        for (auto& group : s.groups)
            for (auto* data : {&group.param, &group.m, &group.v}) {
                data->reserve(std::size_t(params.cap) * group.width);  // only once, so that growth never copies
                data->resize(std::size_t(target) * group.width, 0.0f);
            }
        if (!s.last_step.empty()) s.last_step.resize(std::size_t(target));
        s.count = target;
        to.resize(target - n);
        std::iota(to.begin(), to.end(), static_cast<std::uint32_t>(n));
        fill_rows(s, sums, to, params.min_opacity, RngStream::kGrow, iteration, seed);
        stats.added = target - n;
    }
    s.gradient_sum.clear();  // the statistic belongs to other rows (docs/math/densification.md#mcmc)
    s.gradient_count.clear();
    residuals.resolve();
    stats.count = s.count;
    return stats;
}

}  // namespace gs
