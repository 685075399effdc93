// SPDX-License-Identifier: Apache-2.0
// Row operations: gather and Morton order.
#include <algorithm>
#include <limits>

#include "kernels/core/parallel.h"
#include "kernels/densify/densify.h"
#include "kernels/preprocess/preprocess_device.h"

namespace gs {
namespace {

template <class T> void gather(std::vector<T>& data, int width, const std::vector<std::uint32_t>& order) {
    if (data.empty()) return;
    std::vector<T> out;
    out.reserve(std::max(data.capacity(), order.size() * width)); // keep the room reserved for growth
    out.resize(order.size() * width);
    const std::int64_t n = static_cast<std::int64_t>(order.size());
    parallel_for(num_parts(n), [&](std::int64_t part) {
        for (std::int64_t k = part * kPartSize, end = std::min(n, k + kPartSize); k < end; ++k)
            std::copy_n(&data[std::size_t(order[k]) * width], width, &out[std::size_t(k) * width]);
    });
    data.swap(out);
}

std::uint64_t spread_bits(std::uint64_t x) {
    x &= 0x1fffff;
    x = (x | x << 32) & 0x1f00000000ffffull;
    x = (x | x << 16) & 0x1f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
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
    for (auto& group : state.groups) {
        gather(group.param, group.width, order);
        gather(group.m, group.width, order);
        gather(group.v, group.width, order);
    }
    gather(state.gradient_sum, 1, order);
    gather(state.gradient_count, 1, order);
    state.count = static_cast<std::int64_t>(order.size());
}

std::int64_t remove_nonfinite(Gaussians& state, std::int64_t by_group[kNumGroups]) {
    std::fill_n(by_group, kNumGroups, 0);
    return keep_if(state, [&](std::int64_t i) {
        bool keep = true;
        for (int g = 0; g < kNumGroups; ++g) {
            const auto& group = state.groups[g];
            const float* row = group.param.data() + i * group.width;
            const bool finite = std::all_of(row, row + group.width, [](float x) { return std::isfinite(x); });
            if (!finite) ++by_group[g];
            keep = keep && finite;
        }
        return keep;
    });
}

std::int64_t remove_invisible(Gaussians& state) {
    return keep_if(state, [&](std::int64_t i) {
        const float* q = &state[Group::kRotation].param[4 * i];
        return sigmoid(state[Group::kOpacity].param[i]) >= float(kMinAlpha) && norm2(Vec4<float>{q[0], q[1], q[2], q[3]}) >= float(kMinQuaternionNorm2);
    });
}

std::vector<std::uint32_t> morton_order(const Gaussians& state) {
    const std::vector<float>& means = state[Group::kMean].param;
    float low[3], high[3], extent = 0;
    std::fill(low, low + 3, std::numeric_limits<float>::max());
    std::fill(high, high + 3, std::numeric_limits<float>::lowest());
    for (std::int64_t i = 0; i < 3 * state.count; ++i) {
        low[i % 3] = std::min(low[i % 3], means[i]);
        high[i % 3] = std::max(high[i % 3], means[i]);
    }
    for (int k = 0; k < 3; ++k) extent = std::max(extent, high[k] - low[k]);
    std::vector<std::pair<std::uint64_t, std::uint32_t>> keys(state.count);
    for (std::int64_t i = 0; i < state.count; ++i) {
        std::uint64_t code = 0;
        for (int k = 0; k < 3; ++k) {
            const float t = extent > 0 ? std::clamp((means[3 * i + k] - low[k]) / extent, 0.0f, 1.0f) : 0.0f;
            code |= spread_bits(static_cast<std::uint64_t>(t * 2097151.0f)) << k;
        }
        keys[i] = {code, static_cast<std::uint32_t>(i)};
    }
    std::sort(keys.begin(), keys.end());
    std::vector<std::uint32_t> order(state.count);
    for (std::int64_t i = 0; i < state.count; ++i) order[i] = keys[i].second;
    return order;
}

}  // namespace gs
