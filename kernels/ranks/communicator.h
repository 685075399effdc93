// SPDX-License-Identifier: Apache-2.0
// Communication between the ranks of a training, and its speed. A rank is one of the processes that train one model
// together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <type_traits>
#include <vector>

#include "kernels/base/device_array.h"

namespace gs {

using Bytes = std::span<std::byte>;
using ConstBytes = std::span<const std::byte>;

/// Traffic between a rank and the others. Counts the payload passed to and received from the connection, without the
/// overhead of TCP, NCCL and this connection itself.
struct Traffic {
    double sent = 0, received = 0;      ///< bytes
    std::int64_t messages = 0;          ///< sent or received
    std::int64_t exchanges = 0;         ///< calls of exchange()
    std::int64_t device_exchanges = 0;  ///< calls whose arrays lay on a device
    double seconds = 0;                 ///< time in these calls, including waits for other ranks and for the own device

    Traffic operator-(const Traffic& before) const {
        return {sent - before.sent,
                received - before.received,
                messages - before.messages,
                exchanges - before.exchanges,
                device_exchanges - before.device_exchanges,
                seconds - before.seconds};
    }
    Traffic& operator+=(const Traffic& more) {
        sent += more.sent, received += more.received, messages += more.messages;
        exchanges += more.exchanges, device_exchanges += more.device_exchanges, seconds += more.seconds;
        return *this;
    }
};

/// A direct path for arrays between the devices of ranks, bypassing the host. Communicator::abort() closes it together
/// with all transfers, including transfers that a device waits for; its functions throw from then on.
class DeviceLink {
  public:
    virtual ~DeviceLink() = default;
    /// Returns its name, e.g. "NCCL 2.28.3".
    virtual std::string name() const = 0;
    /// Begins to send out[k] to rank k modulo the number of ranks and to receive in[k] from it, for every other rank.
    /// All arrays lie on `device`. Transfers run after the device's last mark and after earlier transfers. NCCL is fast
    /// if arrays begin at multiples of 16 bytes. Throws DeviceError if the connection has failed or was closed.
    virtual void begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream& device) = 0;
    /// Waits until all transfers are queued on their stream of the device, which does not depend on other ranks once
    /// all are connected. Throws DeviceError like begin().
    virtual void finish() = 0;
};

/// Connects all ranks with each other. Calls wait for the data that they need from other ranks, and throw DeviceError
/// if one of these is lost.
class Communicator {
  public:
    virtual ~Communicator() = default;
    int rank() const { return rank_; }
    int size() const { return size_; }

    /// Sends out[r] to rank r and receives in[r] from it, for all r at once, this rank included. Further arrays follow
    /// in the same order: out[size() + r] and in[size() + r], and so on. An array must have the same size at its sender
    /// and its receiver; nothing is sent if the size is 0. The arrays lie in the memory of `device`, or in host memory
    /// if it is null. Without a link, other ranks may hold theirs elsewhere.
    void exchange(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device = nullptr);
    /// Begins an exchange(). Over a link the arrays are sent once the device has reached its last mark, and are
    /// received while it continues; without a link the exchange is complete on return.
    void begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device);
    /// Waits until all exchanges begun are queued on the device. Until then the memory of the arrays must not be freed.
    void settle() {
        if (link_) finish_on_device();
    }
    /// Makes all work queued on the device from now on wait for the exchanges begun. Until then no work that reads or
    /// changes the arrays may be queued.
    void finish(DeviceStream* device);
    /// Returns the traffic since the beginning.
    const Traffic& traffic() const { return traffic_; }
    /// Sends device arrays over `link` from now on, and no longer through the host. All ranks must do so.
    void use(std::unique_ptr<DeviceLink> link) { link_ = std::move(link); }
    /// Returns the link between the devices, null if there is none.
    const DeviceLink* link() const { return link_.get(); }
    /// Makes the waiting call and all later ones throw. A device that waits for another rank continues, with arbitrary
    /// data in the arrays. May be called from any thread.
    void abort();
    /// Returns a token that is stopped once abort() was called.
    std::stop_token stop_token() const { return stop_.get_token(); }

  protected:
    Communicator(int rank, int size) : rank_(rank), size_(size) {}

    /// Implements begin() for arrays on a device: over the link, or else through host memory.
    virtual void transfer_on_device(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in,
                                    DeviceStream& device);
    /// Implements DeviceLink::finish().
    virtual void finish_on_device() { link_->finish(); }

  private:
    /// Implements begin() for arrays in host memory.
    void transfer_on_host(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in);
    /// Implements exchange() for one array per rank, in host memory.
    virtual void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) = 0;
    /// Makes a waiting transfer() throw.
    virtual void break_off() {}

    int rank_, size_;
    Traffic traffic_;
    std::unique_ptr<DeviceLink> link_;
    std::stop_source stop_;
    std::vector<std::vector<std::byte>> sent_,
        received_;  ///< copies in host memory of device arrays in transfer
};

/// The only rank of a training on one device.
class SingleRank final : public Communicator {
  public:
    SingleRank() : Communicator(0, 1) {}

  private:
    void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) override {
        if (!out[0].empty()) std::memcpy(in[0].data(), out[0].data(), out[0].size());
    }
};

template <class T> ConstBytes bytes_of(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    return std::as_bytes(std::span<const T>(values));
}
template <class T> Bytes room_of(std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>);
    return std::as_writable_bytes(std::span<T>(values));
}

/// Returns the values of all ranks, by rank. Every rank passes the same number of values.
template <class T> std::vector<std::vector<T>> all_gather(Communicator& ranks, const std::vector<T>& values) {
    std::vector<std::vector<T>> all(std::size_t(ranks.size()), std::vector<T>(values.size()));
    std::vector<ConstBytes> out(all.size(), bytes_of(values));
    std::vector<Bytes> in;
    for (auto& one : all) in.push_back(room_of(one));
    ranks.exchange(out, in);
    return all;
}
template <class T> std::vector<T> all_gather(Communicator& ranks, const T& value) {
    std::vector<T> all;
    for (const auto& one : all_gather(ranks, std::vector<T>{value})) all.push_back(one[0]);
    return all;
}

/// Adds up the values of all ranks, in the order of the ranks, so that all get the same.
template <class T> void sum_over_ranks(Communicator& ranks, std::vector<T>& values) {
    if (ranks.size() == 1) return;
    const auto all = all_gather(ranks, values);
    for (std::size_t k = 0; k < values.size(); ++k) {
        double sum = 0;
        for (const auto& one : all) sum += one[k];
        values[k] = T(sum);
    }
}

/// Speed of the connection of one rank with the others while all exchange at the same time, as in a step. 0 if there is
/// only one rank.
struct LinkSpeed {
    double message_bytes = 0;     ///< size of the array that each rank sent in one exchange, and received
    double bytes_per_second = 0;  ///< rate on the path of splats: sent by a rank while it received as many; median
    double latency_seconds = 0;   ///< time of an exchange of 16 bytes with each other rank, host to host: median
    double device_latency_seconds = 0;  ///< the same from device to device, until arrival; 0 without devices
};

/// Measures the connection between the memory of `device` and the devices of other ranks, or between hosts if it is
/// null. All ranks must call it.
LinkSpeed measure_link(Communicator& ranks, DeviceStream* device);

}  // namespace gs
