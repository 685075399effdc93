// SPDX-License-Identifier: Apache-2.0
// Times exchanges of large and of small messages.
#include "kernels/ranks/link_speed.h"

#include <algorithm>

namespace gs {
namespace {

/// Large enough that latency does not count.
constexpr std::size_t kSent = std::size_t(32) << 20;
constexpr int kLargeExchanges = 7, kSmallExchanges = 201;

/// Returns the median time of `count` exchanges of `size` bytes with each other rank, after two to warm up.
double median_exchange(Communicator& ranks, std::size_t size, int count) {
    const std::size_t num_ranks = std::size_t(ranks.size());
    const std::vector<std::byte> sent(size);
    std::vector<std::vector<std::byte>> received(num_ranks);
    std::vector<ConstBytes> out(num_ranks);
    std::vector<Bytes> in(num_ranks);
    for (std::size_t r = 0; r < num_ranks; ++r) {
        if (int(r) == ranks.rank()) continue;
        received[r].resize(size);
        out[r] = sent, in[r] = received[r];
    }
    std::vector<double> times;
    for (int k = -2; k < count; ++k) {
        const double start = seconds_now();
        ranks.exchange(out, in);
        if (k >= 0) times.push_back(seconds_now() - start);
    }
    const auto middle = times.begin() + std::ptrdiff_t(times.size() / 2);
    std::nth_element(times.begin(), middle, times.end());
    return *middle;
}

}  // namespace

LinkSpeed measure_link(Communicator& ranks) {
    if (ranks.size() == 1) return {};
    const std::size_t others = std::size_t(ranks.size() - 1), size = kSent / others;
    const double large = median_exchange(ranks, size, kLargeExchanges);
    return {double(size * others), double(size * others) / large, median_exchange(ranks, 1, kSmallExchanges)};
}

}  // namespace gs
