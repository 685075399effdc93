// SPDX-License-Identifier: Apache-2.0
// What the ranks of a training say to each other, and how fast. A rank is one of the processes that train one model
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

/// Traffic between a rank and the others. Counts what is handed to the connection and what it delivers, without what
/// TCP, NCCL and this connection itself add.
struct Traffic {
    double sent = 0, received = 0;      ///< bytes
    std::int64_t messages = 0;          ///< sent or received
    std::int64_t exchanges = 0;         ///< calls of exchange()
    std::int64_t device_exchanges = 0;  ///< those of them whose arrays lay on a device
    double seconds = 0;                 ///< in these calls, waiting for other ranks and for the own device included

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

/// A way on which arrays go from one rank's device to another's without the host. It ends when Communicator::abort() is
/// called, with all transfers, also those that a device waits for; its functions throw from then on.
class DeviceLink {
  public:
    virtual ~DeviceLink() = default;
    /// Names it: "NCCL 2.28.3".
    virtual std::string name() const = 0;
    /// Begins to send out[k] to every other rank k modulo their number and to receive in[k] from it, all of them on
    /// `device`, after what it marked last and after earlier transfers. NCCL is fast where arrays begin at multiples of
    /// 16 bytes. Throws DeviceError when the connection has failed or was ended.
    virtual void begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream& device) = 0;
    /// Waits until all transfers are on the device's stream for them, which does not take other ranks once all are
    /// connected. Throws DeviceError like begin().
    virtual void finish() = 0;
};

/// Connects all ranks with each other. Calls wait for what they need from other ranks, and throw DeviceError when one
/// of these is lost.
class Communicator {
  public:
    virtual ~Communicator() = default;
    int rank() const { return rank_; }
    int size() const { return size_; }

    /// Sends out[r] to rank r and receives in[r] from it, for all r at once, its own included, and if there are more
    /// arrays out[size() + r] and in[size() + r] after these, and so on. What one rank sends and what the other expects
    /// must have the same size; nothing is sent if that is 0. The arrays lie in the memory of `device`, or in the
    /// host's if that is null; they may lie elsewhere on another rank, unless there is a link.
    void exchange(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device = nullptr);
    /// Begins what exchange() does. By a link the arrays are sent when the device has done what it marked last, and
    /// received while it goes on; without one all is done when the function returns.
    void begin(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in, DeviceStream* device);
    /// Waits until the device has been told of all that was begun. Before, the memory of the arrays must not be given
    /// back.
    void settle() {
        if (link_) finish_on_device();
    }
    /// Lets all that the device is told from now on wait for what was begun. It must not be told to change or to read
    /// the arrays before.
    void finish(DeviceStream* device);
    /// Returns what was exchanged since the beginning.
    const Traffic& traffic() const { return traffic_; }
    /// Sends arrays of devices over `link` from now on, and no longer through the host. All ranks must do so.
    void use(std::unique_ptr<DeviceLink> link) { link_ = std::move(link); }
    /// Returns the link between the devices, null if there is none.
    const DeviceLink* link() const { return link_.get(); }
    /// Makes the call that waits, and all that follow, throw; a device that waits for another rank goes on, with
    /// whatever is in the arrays. May be called from any thread.
    void abort();
    /// Returns what says whether abort() was called.
    std::stop_token stop_token() const { return stop_.get_token(); }

  protected:
    Communicator(int rank, int size) : rank_(rank), size_(size) {}

    /// Does what begin() says, with arrays on a device: over the link, or else through the host's memory.
    virtual void transfer_on_device(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in,
                                    DeviceStream& device);
    /// Does what DeviceLink::finish() says.
    virtual void finish_on_device() { link_->finish(); }

  private:
    /// Does what begin() says, with arrays in the host's memory.
    void transfer_on_host(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in);
    /// Does what exchange() says with an array for each rank, in the host's memory.
    virtual void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) = 0;
    /// Makes transfer() throw if it waits.
    virtual void break_off() {}

    int rank_, size_;
    Traffic traffic_;
    std::unique_ptr<DeviceLink> link_;
    std::stop_source stop_;
    std::vector<std::vector<std::byte>> sent_,
        received_;  ///< arrays of a device on their way through the host
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

/// Returns the values of all ranks, by rank. Every rank gives as many.
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

/// The connection of one rank with the others, while all exchange at the same time as they do in a step. 0 for a rank
/// alone.
struct LinkSpeed {
    double message_bytes = 0;     ///< that each rank sent in one exchange, and received
    double bytes_per_second = 0;  ///< of the way that splats take: sent by a rank while it received as many, median
    double latency_seconds = 0;   ///< of an exchange of 16 bytes with each other rank, host to host: median
    double device_latency_seconds = 0;  ///< of one of 16 bytes from device to device, until it is there; 0 without any
};

/// Measures the connection, from the memory of `device` to that of the other ranks', or between hosts if it is null.
/// All ranks must call it.
LinkSpeed measure_link(Communicator& ranks, DeviceStream* device);

}  // namespace gs
