// SPDX-License-Identifier: Apache-2.0
// Counts the traffic of exchanges, passes device arrays through the host if no link connects the devices, and times
// exchanges of large and small messages.
#include "kernels/ranks/communicator.h"

#include <algorithm>

#include "kernels/base/clock.h"

namespace gs {
namespace {

/// Bytes of a large message, for which latency is negligible.
constexpr std::size_t kSent = std::size_t(32) << 20;
/// Bytes of a small message, whose time is all latency; whole words, as NCCL reads them.
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

void Communicator::exchange(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device) {
    if (device && link_) device->mark();
    begin(out, in, device);
    finish(device);
}

void Communicator::finish(DeviceStream* device) {
    if (!device || !link_) return;
    const double start = seconds_now();
    finish_on_device();
    device->join_transfers();
    traffic_.seconds += seconds_now() - start;
}

void Communicator::begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device) {
    const double start = seconds_now();
    if (device)
        transfer_on_device(out, in, *device);
    else
        transfer_on_host(out, in);
    for (std::size_t k = 0; k < out.size(); ++k) {
        if (k % std::size_t(size_) == std::size_t(rank_)) continue;
        traffic_.sent += double(out[k].size()), traffic_.received += double(in[k].size());
        traffic_.messages += int(!out[k].empty()) + int(!in[k].empty());
    }
    ++traffic_.exchanges;
    traffic_.device_exchanges += device ? 1 : 0;
    traffic_.seconds += seconds_now() - start;
}

void Communicator::transfer_on_host(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) {
    const std::ptrdiff_t size = size_;
    for (std::ptrdiff_t k = 0; k < std::ptrdiff_t(out.size()); k += size)
        transfer({out.begin() + k, out.begin() + k + size}, {in.begin() + k, in.begin() + k + size});
}

void Communicator::abort() {
    break_off();
    stop_.request_stop();
}

void Communicator::transfer_on_device(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in,
                                      DeviceStream& device) {
    const auto is_own = [this](std::size_t k) { return k % std::size_t(size_) == std::size_t(rank_); };
    for (std::size_t k = 0; k < out.size(); ++k)
        if (is_own(k) && !out[k].empty() && !in[k].empty()) device.copy(in[k].data(), out[k].data(), in[k].size());
    if (link_) return link_->begin(out, in, device);
    if (size_ == 1) return;
    sent_.resize(out.size()), received_.resize(in.size());
    std::vector<ConstBytes> host_out(out.size());
    std::vector<Bytes> host_in(in.size());
    for (std::size_t k = 0; k < out.size(); ++k) {
        if (is_own(k)) continue;
        sent_[k].resize(out[k].size()), received_[k].resize(in[k].size());
        host_out[k] = sent_[k], host_in[k] = received_[k];
        if (!out[k].empty()) device.copy(sent_[k].data(), out[k].data(), out[k].size());
    }
    device.wait();
    transfer_on_host(host_out, host_in);
    for (std::size_t k = 0; k < in.size(); ++k)
        if (!is_own(k) && !in[k].empty()) device.copy(in[k].data(), received_[k].data(), in[k].size());
    device.wait();  // the next arrays reuse this memory
}

LinkSpeed measure_link(Communicator& ranks, DeviceStream* device) {
    if (ranks.size() == 1) return {};
    const std::size_t others = std::size_t(ranks.size() - 1), size = kSent / others;
    LinkSpeed speed;
    speed.message_bytes = double(size * others);
    speed.bytes_per_second = double(size * others) / median_exchange(ranks, device, size, kLargeExchanges);
    speed.latency_seconds = median_exchange(ranks, nullptr, kSmall, kSmallExchanges);
    // All ranks do as many exchanges, even if they compute on different kinds of device.
    const double of_device = median_exchange(ranks, device, kSmall, kSmallExchanges);
    if (device) speed.device_latency_seconds = of_device;
    return speed;
}

}  // namespace gs
