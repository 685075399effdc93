// SPDX-License-Identifier: Apache-2.0
// MCMC densification: relocate the dead, then grow (densification spec section 1).
#include <algorithm>

#include "kernels/densify/densify.h"
#include "kernels/densify/relocation_device.h"

namespace gs {
namespace {

double opacity_of(const Gaussians& s, std::int64_t i) {
    const double o = sigmoid(double(s[Group::kOpacity].param[i]));
    return std::isfinite(o) ? o : 0.0;
}

bool degenerate_rotation(const Gaussians& s, std::int64_t i) {
    const float* q = &s[Group::kRotation].param[4 * i];
    return !(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] >= float(kMinQuaternionNorm2));
}

/// Draws n indices with replacement, probability proportional to weight. Empty if all weights are 0.
std::vector<std::uint32_t> draw(const std::vector<double>& weights, std::int64_t n, RngStream stream, std::int64_t iteration, std::uint64_t seed) {
    std::vector<double> sums(weights.size());
    double total = 0;
    for (std::size_t i = 0; i < weights.size(); ++i) sums[i] = total += weights[i];
    std::vector<std::uint32_t> out;
    if (!(total > 0)) return out;
    out.resize(n);
    for (std::int64_t k = 0; k < n; ++k) {
        const Philox4 r = philox(seed, stream, std::uint64_t(iteration), std::uint32_t(k));
        const double u = (double(std::uint64_t(r.v[0]) << 21 ^ r.v[1] >> 11) + 0.5) / 9007199254740992.0; // 53 bits
        const auto at = std::upper_bound(sums.begin(), sums.end(), u * total);
        out[k] = static_cast<std::uint32_t>(std::min<std::size_t>(at - sums.begin(), sums.size() - 1));
    }
    return out;
}

/// Gives every drawn Gaussian the opacity and scale of its share, and zeroes its moments.
void share(Gaussians& s, const std::vector<std::uint32_t>& drawn, float min_opacity) {
    std::vector<std::int32_t> times(s.count, 0);
    for (std::uint32_t j : drawn) ++times[j];
    for (std::int64_t j = 0; j < s.count; ++j) {
        if (!times[j]) continue;
        const Relocated r = relocate(opacity_of(s, j), times[j] + 1);
        const double o = std::clamp(r.opacity, double(min_opacity), 1 - 1.1920928955078125e-7);
        s[Group::kOpacity].param[j] = float(std::log(o) - std::log1p(-o));
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * j + k] += float(std::log(r.scale_factor));
        for (auto& group : s.groups) {
            std::fill_n(group.m.begin() + j * group.width, group.width, 0.0f);
            std::fill_n(group.v.begin() + j * group.width, group.width, 0.0f);
        }
    }
}

}  // namespace

DensifyStats mcmc_densify(Gaussians& s, const McmcParams& params, std::int64_t iteration, std::uint64_t seed) {
    DensifyStats stats;
    const float dead_logit = std::log(params.min_opacity / (1 - params.min_opacity));
    std::vector<std::uint32_t> dead;
    std::vector<double> weights(s.count);
    for (std::int64_t i = 0; i < s.count; ++i) {
        const bool is_dead = !(s[Group::kOpacity].param[i] > dead_logit) || degenerate_rotation(s, i);
        weights[i] = is_dead ? 0.0 : opacity_of(s, i);
        if (is_dead) dead.push_back(static_cast<std::uint32_t>(i));
    }
    // Dead rows keep their own old moments, as in all references.
    const auto sources = draw(weights, static_cast<std::int64_t>(dead.size()), RngStream::kRelocate, iteration, seed);
    share(s, sources, params.min_opacity);
    for (std::size_t k = 0; k < sources.size(); ++k)
        for (auto& group : s.groups)
            std::copy_n(&group.param[std::size_t(sources[k]) * group.width], group.width, group.param.begin() + std::size_t(dead[k]) * group.width);
    stats.relocated = static_cast<std::int64_t>(sources.size());

    // 5 % more; at least one, or fewer than 20 Gaussians would never grow. A start above the cap is kept.
    const auto target = std::min<std::int64_t>(params.cap, std::max<std::int64_t>(s.count + 1, std::int64_t(params.growth * double(s.count))));
    if (target > s.count && s.count > 0) {
        for (std::int64_t i = 0; i < s.count; ++i) weights[i] = opacity_of(s, i);
        const auto parents = draw(weights, target - s.count, RngStream::kGrow, iteration, seed);
        share(s, parents, params.min_opacity);
        const std::int64_t first = s.count;
        s.count += static_cast<std::int64_t>(parents.size());
        for (auto& group : s.groups) {
            for (auto* data : {&group.param, &group.m, &group.v}) {
                data->reserve(std::size_t(params.cap) * group.width); // once: growth then never copies
                data->resize(std::size_t(s.count) * group.width, 0.0f);
            }
            for (std::size_t k = 0; k < parents.size(); ++k)
                std::copy_n(group.param.begin() + std::size_t(parents[k]) * group.width, group.width,
                            group.param.begin() + std::size_t(first + std::int64_t(k)) * group.width);
        }
        stats.added = static_cast<std::int64_t>(parents.size());
    }
    stats.count = s.count;
    return stats;
}

}  // namespace gs
