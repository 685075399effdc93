// SPDX-License-Identifier: Apache-2.0
#include "kernels/densify/mcmc_plan.h"

#include <algorithm>
#include <cmath>

#include "kernels/densify/relocation_device.h"

namespace gs {
namespace {

double opacity_of(float raw) {
    const double o = sigmoid(double(raw));
    return std::isfinite(o) ? o : 0.0;
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

/// Every drawn Gaussian gets the opacity and scale of its share.
void share(McmcRound& round, std::vector<float>& raw_opacities, float min_opacity) {
    std::vector<std::int32_t> times(raw_opacities.size(), 0);
    for (std::uint32_t j : round.from) ++times[j];
    for (std::size_t j = 0; j < times.size(); ++j) {
        if (!times[j]) continue;
        const Relocated r = relocate(opacity_of(raw_opacities[j]), times[j] + 1);
        const double o = std::clamp(r.opacity, double(min_opacity), 1 - 1.1920928955078125e-7);
        raw_opacities[j] = float(std::log(o) - std::log1p(-o));
        round.sources.push_back(static_cast<std::uint32_t>(j));
        round.raw_opacity.push_back(raw_opacities[j]);
        round.log_scale_shift.push_back(float(std::log(r.scale_factor)));
    }
}

}  // namespace

McmcPlan plan_mcmc(std::vector<float>& raw_opacities, const std::vector<char>& usable, const McmcParams& params, std::int64_t iteration, std::uint64_t seed) {
    const auto n = static_cast<std::int64_t>(raw_opacities.size());
    const float dead_logit = std::log(params.min_opacity / (1 - params.min_opacity));
    McmcPlan plan;
    std::vector<double> weights(n);
    for (std::int64_t i = 0; i < n; ++i) {
        const bool dead = !(raw_opacities[i] > dead_logit) || !usable[i];
        weights[i] = dead ? 0.0 : opacity_of(raw_opacities[i]);
        if (dead) plan.relocate.to.push_back(static_cast<std::uint32_t>(i));
    }
    plan.relocate.from = draw(weights, static_cast<std::int64_t>(plan.relocate.to.size()), RngStream::kRelocate, iteration, seed);
    plan.relocate.to.resize(plan.relocate.from.size()); // none alive: nothing moves
    share(plan.relocate, raw_opacities, params.min_opacity);
    for (std::size_t k = 0; k < plan.relocate.to.size(); ++k) raw_opacities[plan.relocate.to[k]] = raw_opacities[plan.relocate.from[k]];

    // 5 % more; at least one, or fewer than 20 Gaussians would never grow. A start above the cap is kept.
    plan.count = n;
    const auto target = std::min<std::int64_t>(params.cap, std::max<std::int64_t>(n + 1, std::int64_t(params.growth * double(n))));
    if (target > n && n > 0) {
        for (std::int64_t i = 0; i < n; ++i) weights[i] = opacity_of(raw_opacities[i]);
        plan.grow.from = draw(weights, target - n, RngStream::kGrow, iteration, seed);
        for (std::size_t k = 0; k < plan.grow.from.size(); ++k) plan.grow.to.push_back(static_cast<std::uint32_t>(n + std::int64_t(k)));
        share(plan.grow, raw_opacities, params.min_opacity);
        plan.count += static_cast<std::int64_t>(plan.grow.from.size());
    }
    return plan;
}

}  // namespace gs
