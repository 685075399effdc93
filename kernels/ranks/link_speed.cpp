// SPDX-License-Identifier: Apache-2.0
// Times exchanges of large and of small messages.
#include "kernels/ranks/link_speed.h"

#include <algorithm>

#include "kernels/base/clock.h"
#include "kernels/base/device_array.h"

namespace gs {
namespace {

/// Large enough that latency does not count.
constexpr std::size_t kSent = std::size_t(32) << 20;
/// Small enough that only latency counts, and whole words, in which NCCL reads.
constexpr std::size_t kSmall = 16;
constexpr int kLargeExchanges = 7, kSmallExchanges = 201;

/// Returns the median time of `count` exchanges of `size` bytes with each other rank, after two to warm up.
double median_exchange(Communicator& ranks, DeviceStream* device, std::size_t size, int count) {
    const std::size_t num_ranks = std::size_t(ranks.size());
    DeviceArray<std::byte> sent(device);
    sent.assign(std::vector<std::byte>(size));
    std::vector<DeviceArray<std::byte>> received;
    std::vector<ConstBytes> out(num_ranks);
    std::vector<Bytes> in(num_ranks);
    for (std::size_t r = 0; r < num_ranks; ++r) {
        received.emplace_back(device);
        if (int(r) == ranks.rank()) continue;
        received[r].resize(size);
        out[r] = sent.bytes(), in[r] = received[r].bytes();
    }
    std::vector<double> times;
    for (int k = -2; k < count; ++k) {
        const double start = seconds_now();
        ranks.exchange(out, in, device);
        if (device) device->wait();
        if (k >= 0) times.push_back(seconds_now() - start);
    }
    const auto middle = times.begin() + std::ptrdiff_t(times.size() / 2);
    std::nth_element(times.begin(), middle, times.end());
    return *middle;
}

}  // namespace

LinkSpeed measure_link(Communicator& ranks, DeviceStream* device) {
    if (ranks.size() == 1) return {};
    const std::size_t others = std::size_t(ranks.size() - 1), size = kSent / others;
    LinkSpeed speed;
    speed.message_bytes = double(size * others);
    speed.bytes_per_second = double(size * others) / median_exchange(ranks, device, size, kLargeExchanges);
    speed.latency_seconds = median_exchange(ranks, nullptr, kSmall, kSmallExchanges);
    // All ranks do as many exchanges, on whatever they compute.
    const double of_device = median_exchange(ranks, device, kSmall, kSmallExchanges);
    if (device) speed.device_latency_seconds = of_device;
    return speed;
}

}  // namespace gs
