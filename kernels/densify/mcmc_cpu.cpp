// SPDX-License-Identifier: Apache-2.0
// MCMC densification on host arrays.
#include <algorithm>

#include "kernels/densify/densify.h"
#include "kernels/densify/mcmc_plan.h"
#include "kernels/preprocess/preprocess_device.h"

namespace gs {
namespace {

void apply(Gaussians& s, const McmcRound& round) {
    for (std::size_t k = 0; k < round.sources.size(); ++k) {
        const std::size_t j = round.sources[k];
        s[Group::kOpacity].param[j] = round.raw_opacity[k];
        for (int c = 0; c < 3; ++c) s[Group::kScale].param[3 * j + c] += round.log_scale_shift[k];
        for (auto& group : s.groups) {
            std::fill_n(group.m.begin() + std::ptrdiff_t(j * group.width), group.width, 0.0f);
            std::fill_n(group.v.begin() + std::ptrdiff_t(j * group.width), group.width, 0.0f);
        }
    }
    for (auto& group : s.groups)
        for (std::size_t k = 0; k < round.to.size(); ++k)
            std::copy_n(group.param.begin() + std::ptrdiff_t(round.from[k]) * group.width, group.width,
                        group.param.begin() + std::ptrdiff_t(round.to[k]) * group.width);
}

}  // namespace

DensifyStats mcmc_densify(Gaussians& s, const McmcParams& params, std::int64_t iteration, std::uint64_t seed) {
    std::vector<char> usable(s.count);
    for (std::int64_t i = 0; i < s.count; ++i) {
        const float* q = &s[Group::kRotation].param[4 * i];
        usable[i] = norm2(Vec4<float>{q[0], q[1], q[2], q[3]}) >= float(kMinQuaternionNorm2);
    }
    std::vector<float> raw_opacities(s[Group::kOpacity].param);
    const McmcPlan plan = plan_mcmc(raw_opacities, usable, params, iteration, seed);
    apply(s, plan.relocate);
    if (plan.count > s.count) {
        for (auto& group : s.groups)
            for (auto* data : {&group.param, &group.m, &group.v}) {
                data->reserve(std::size_t(params.cap) * group.width); // once: growth then never copies
                data->resize(std::size_t(plan.count) * group.width, 0.0f);
            }
        s.count = plan.count;
        apply(s, plan.grow);
    }
    return {static_cast<std::int64_t>(plan.relocate.to.size()), static_cast<std::int64_t>(plan.grow.to.size()), 0, 0, 0, s.count};
}

}  // namespace gs
