// SPDX-License-Identifier: Apache-2.0
// What the ranks of a training say to each other. A rank is one of the processes that train one model together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

#include "kernels/core/clock.h"

namespace gs {

using Bytes = std::span<std::byte>;
using ConstBytes = std::span<const std::byte>;

/// What a rank has exchanged with others. Counts what is handed to the connection and what it delivers, without the
/// headers that TCP and Gloo add.
struct Traffic {
    double sent = 0, received = 0;  ///< bytes
    std::int64_t messages = 0;      ///< sent or received
    std::int64_t exchanges = 0;     ///< calls of exchange()
    double seconds = 0;             ///< in these, waiting for other ranks included

    Traffic operator-(const Traffic& before) const {
        return {sent - before.sent, received - before.received, messages - before.messages,
                exchanges - before.exchanges, seconds - before.seconds};
    }
    Traffic& operator+=(const Traffic& more) {
        sent += more.sent, received += more.received, messages += more.messages;
        exchanges += more.exchanges, seconds += more.seconds;
        return *this;
    }
};

/// Connects all ranks with each other. Calls wait for what they need from other ranks, and throw DeviceError when one
/// of these is lost.
class Communicator {
  public:
    virtual ~Communicator() = default;
    int rank() const { return rank_; }
    int size() const { return size_; }

    /// Sends out[r] to rank r and receives in[r] from it, for all r at once, its own included. What one rank sends and
    /// what the other expects must have the same size; nothing is sent where that is 0.
    void exchange(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) {
        const double start = seconds_now();
        transfer(out, in);
        for (std::size_t r = 0; r < out.size(); ++r) {
            if (int(r) == rank_) continue;
            traffic_.sent += double(out[r].size()), traffic_.received += double(in[r].size());
            traffic_.messages += int(!out[r].empty()) + int(!in[r].empty());
        }
        ++traffic_.exchanges;
        traffic_.seconds += seconds_now() - start;
    }
    /// Returns what was exchanged since the beginning.
    const Traffic& traffic() const { return traffic_; }
    /// Makes the call that waits, and all that follow, throw. May be called from any thread.
    virtual void abort() = 0;

  protected:
    Communicator(int rank, int size) : rank_(rank), size_(size) {}

  private:
    /// Does what exchange() says.
    virtual void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) = 0;

    int rank_, size_;
    Traffic traffic_;
};

/// The only rank of a training on one device.
class SingleRank final : public Communicator {
  public:
    SingleRank() : Communicator(0, 1) {}
    void abort() override {}

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

}  // namespace gs
