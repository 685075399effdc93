// SPDX-License-Identifier: Apache-2.0
// Adaptive density control: clone, split, prune (densification spec section 2).
#include <algorithm>

#include "kernels/core/error.h"
#include "kernels/densify/densify.h"
#include "kernels/densify/relocation_device.h"

namespace gs {
namespace {

/// Opacity 0.01, the value of the reset.
constexpr float kResetLogit = -4.595119953155518f;
/// Children of a split are this much smaller.
constexpr float kSplitShrink = 1.6f;

float max_log_scale(const Gaussians& s, std::int64_t i) {
    const float* v = &s[Group::kScale].param[3 * i];
    return std::max({v[0], v[1], v[2]});
}

void append_copy(Gaussians& s, std::int64_t parent) {
    for (auto& group : s.groups) {
        group.param.resize(group.param.size() + group.width);
        std::copy_n(group.param.begin() + parent * group.width, group.width, group.param.end() - group.width);
        group.m.resize(group.m.size() + group.width, 0.0f);
        group.v.resize(group.v.size() + group.width, 0.0f);
    }
    ++s.count;
}

void split(Gaussians& s, std::int64_t parent, std::int64_t iteration, std::uint64_t seed) {
    const float* q = &s[Group::kRotation].param[4 * parent];
    const Mat3<float> r = rotation_matrix(Vec4<float>{q[0], q[1], q[2], q[3]});
    const float* l = &s[Group::kScale].param[3 * parent];
    const Vec3<float> sigma{std::exp(l[0]), std::exp(l[1]), std::exp(l[2])};
    for (std::uint32_t child = 0; child < 2; ++child) {
        float xi[4];
        normals_from(philox(seed, RngStream::kSplit, std::uint64_t(iteration), std::uint32_t(2 * parent + child)), xi);
        const Vec3<float> offset = r * (sigma * Vec3<float>{xi[0], xi[1], xi[2]});
        append_copy(s, parent);
        float* mean = &s[Group::kMean].param[3 * (s.count - 1)];
        mean[0] += offset.x, mean[1] += offset.y, mean[2] += offset.z;
        for (int k = 0; k < 3; ++k) s[Group::kScale].param[3 * (s.count - 1) + k] -= std::log(kSplitShrink);
    }
}

}  // namespace

DensifyStats adc_densify(Gaussians& s, const AdcParams& params, std::int64_t iteration, std::uint64_t seed) {
    DensifyStats stats;
    const std::int64_t before = s.count;
    s.gradient_sum.resize(before, 0.0f); // nothing gathered yet: nothing grows
    s.gradient_count.resize(before, 0.0f);
    std::vector<std::pair<float, std::uint32_t>> growers; // (-mean gradient, index)
    for (std::int64_t i = 0; i < before; ++i) {
        const float n = std::max(s.gradient_count[i], 1.0f);
        if (s.gradient_sum[i] >= params.grad_threshold * n) growers.emplace_back(-s.gradient_sum[i] / n, std::uint32_t(i));
    }
    // Each clone or split adds one Gaussian. At the cap the strongest gradients grow first.
    const std::int64_t room = params.cap > 0 ? std::max<std::int64_t>(0, params.cap - before) : std::int64_t(growers.size());
    if (std::int64_t(growers.size()) > room) {
        std::sort(growers.begin(), growers.end());
        growers.resize(room);
        std::sort(growers.begin(), growers.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    }
    std::vector<char> remove(before, 0);
    const float dense = std::log(params.dense_fraction * params.extent);
    for (const auto& [gradient, i] : growers)
        if (max_log_scale(s, i) <= dense) append_copy(s, i), ++stats.cloned;
    for (const auto& [gradient, i] : growers)
        if (!(max_log_scale(s, i) <= dense)) split(s, i, iteration, seed), remove[i] = 1, ++stats.split;

    const float min_logit = std::log(params.min_opacity / (1 - params.min_opacity));
    const float large = std::log(0.1f * params.extent);
    std::vector<std::uint32_t> keep;
    for (std::int64_t i = 0; i < s.count; ++i) {
        if (i < before && remove[i]) continue;
        const float* q = &s[Group::kRotation].param[4 * i];
        const bool visible = s[Group::kOpacity].param[i] >= min_logit && norm2(Vec4<float>{q[0], q[1], q[2], q[3]}) >= float(kMinQuaternionNorm2);
        if (visible && !(params.prune_large && max_log_scale(s, i) > large))
            keep.push_back(std::uint32_t(i));
        else
            ++stats.pruned;
    }
    if (keep.empty())
        throw NumericError("iteration " + std::to_string(iteration) + ": densification pruned all " + std::to_string(s.count) +
                           " Gaussians (opacity below " + std::to_string(params.min_opacity) + " or scale above 0.1 of the scene extent)");
    s.gradient_sum.clear(); // the statistic starts anew
    s.gradient_count.clear();
    gather_rows(s, keep);
    stats.count = s.count;
    return stats;
}

void adc_reset_opacity(Gaussians& s) {
    auto& group = s[Group::kOpacity];
    for (float& x : group.param) x = std::min(x, kResetLogit);
    std::fill(group.m.begin(), group.m.end(), 0.0f);
    std::fill(group.v.begin(), group.v.end(), 0.0f);
}

}  // namespace gs
