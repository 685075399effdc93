// SPDX-License-Identifier: Apache-2.0
// Counts what is exchanged, and takes arrays of a device through the host where no link goes from device to device.
#include "kernels/ranks/communicator.h"

#include "kernels/core/clock.h"

namespace gs {

void Communicator::exchange(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, RankDevice* device) {
    if (device && link_) device->mark();
    begin(out, in, device);
    finish(device);
}

void Communicator::finish(RankDevice* device) {
    if (!device || !link_) return;
    const double start = seconds_now();
    finish_on_device();
    device->join_transfers();
    traffic_.seconds += seconds_now() - start;
}

void Communicator::begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, RankDevice* device) {
    const double start = seconds_now();
    if (device)
        transfer_on_device(out, in, *device);
    else
        transfer(out, in);
    for (std::size_t r = 0; r < out.size(); ++r) {
        if (int(r) == rank_) continue;
        traffic_.sent += double(out[r].size()), traffic_.received += double(in[r].size());
        traffic_.messages += int(!out[r].empty()) + int(!in[r].empty());
    }
    ++traffic_.exchanges;
    traffic_.device_exchanges += device ? 1 : 0;
    traffic_.seconds += seconds_now() - start;
}

void Communicator::abort() {
    break_off();
    stop_.request_stop();
}

void Communicator::transfer_on_device(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in,
                                      RankDevice& device) {
    const auto self = std::size_t(rank_);
    if (!out[self].empty() && !in[self].empty()) device.copy(in[self].data(), out[self].data(), in[self].size());
    if (link_) return link_->begin(out, in, device);
    if (size_ == 1) return;
    sent_.resize(out.size()), received_.resize(in.size());
    std::vector<ConstBytes> host_out(out.size());
    std::vector<Bytes> host_in(in.size());
    for (std::size_t r = 0; r < out.size(); ++r) {
        if (r == self) continue;
        sent_[r].resize(out[r].size()), received_[r].resize(in[r].size());
        host_out[r] = sent_[r], host_in[r] = received_[r];
        if (!out[r].empty()) device.copy(sent_[r].data(), out[r].data(), out[r].size());
    }
    device.wait();
    transfer(host_out, host_in);
    for (std::size_t r = 0; r < in.size(); ++r)
        if (r != self && !in[r].empty()) device.copy(in[r].data(), received_[r].data(), in[r].size());
    device.wait();  // the next arrays take the place of these
}

}  // namespace gs
