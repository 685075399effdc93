// SPDX-License-Identifier: Apache-2.0
// Sends and receives on all sockets at once, in the calling thread.
#include "kernels/ranks/socket_communicator.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/uio.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>

#include "kernels/base/error.h"

namespace gs {
namespace {

using Size = std::uint64_t;

/// Seconds of silence before a machine is probed, and the number of unanswered probes after which it counts as lost.
constexpr int kKeepAliveSeconds = 15, kKeepAliveTries = 4;

/// An array in transfer in one direction, preceded by its size.
class Transfer {
  public:
    Transfer(std::byte* data, std::size_t bytes) : data_(data), size_(bytes), header_(bytes), left_(bytes) {
        if (bytes > 0) left_ += sizeof header_;
    }
    bool is_done() const { return left_ == 0; }
    /// Returns whether the size has been transferred.
    bool has_size() const { return left_ <= size_; }
    /// Returns the size that was sent.
    Size header() const { return header_; }
    /// Calls move(message), which returns the number of bytes moved, or a negative value with errno for none.
    template <class Move> ssize_t advance(Move&& move) {
        const std::size_t header_left = left_ > size_ ? left_ - size_ : 0, data_left = left_ - header_left;
        std::array<iovec, 2> parts{
            {{reinterpret_cast<std::byte*>(&header_) + sizeof header_ - header_left, header_left},
             {data_ + size_ - data_left, data_left}}};
        msghdr message{};
        message.msg_iov = parts.data(), message.msg_iovlen = parts.size();
        const ssize_t moved = move(message);
        if (moved > 0) left_ -= std::size_t(moved);
        return moved;
    }

  private:
    std::byte* data_;
    Size size_, header_;
    std::size_t left_;  ///< bytes left of size and array
};

class SocketCommunicator final : public Communicator {
  public:
    SocketCommunicator(int rank, std::vector<Descriptor> to_rank)
        : Communicator(rank, int(to_rank.size())),
          to_rank_(std::move(to_rank)),
          wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
        if (!wake_.is_open()) throw DeviceError(std::string("cannot connect the ranks: ") + std::strerror(errno));
        for (const Descriptor& socket : to_rank_) {
            // Sockets within one machine may not support these options, and do not need them.
            const auto set = [&](int level, int option, int value) {
                ::setsockopt(socket.fd(), level, option, &value, sizeof value);
            };
            set(IPPROTO_TCP, TCP_NODELAY, 1);  // short messages are sent at once
            set(SOL_SOCKET, SO_KEEPALIVE, 1);  // detects a lost machine while others wait for it
            set(IPPROTO_TCP, TCP_KEEPIDLE, kKeepAliveSeconds);
            set(IPPROTO_TCP, TCP_KEEPINTVL, kKeepAliveSeconds);
            set(IPPROTO_TCP, TCP_KEEPCNT, kKeepAliveTries);
        }
    }

  private:
    void break_off() override {
        aborted_ = true;
        ::eventfd_write(wake_.fd(), 1);  // is never read, so that all later waits end, too
    }

    void transfer(const std::vector<ConstBytes>& out, const std::vector<Bytes>& in) override {
        const auto self = std::size_t(rank());
        if (!out[self].empty() && !in[self].empty()) std::memcpy(in[self].data(), out[self].data(), in[self].size());
        std::vector<Transfer> sends, receives;
        for (std::size_t r = 0; r < out.size(); ++r) {
            // Sending does not write to the array.
            sends.emplace_back(const_cast<std::byte*>(out[r].data()), r == self ? 0 : out[r].size());
            receives.emplace_back(in[r].data(), r == self ? 0 : in[r].size());
        }
        std::vector<pollfd> waits;
        std::vector<short> ready(out.size(), POLLIN | POLLOUT);
        while (true) {
            if (aborted_) throw DeviceError("the connection to the other ranks was ended");
            waits.assign(1, {wake_.fd(), POLLIN, 0});
            for (std::size_t r = 0; r < out.size(); ++r) {
                if (!sends[r].is_done() && ready[r] & ~POLLIN) send(r, sends[r]);
                if (!receives[r].is_done() && ready[r] & ~POLLOUT) receive(r, receives[r], in[r].size());
                const int events = (sends[r].is_done() ? 0 : POLLOUT) | (receives[r].is_done() ? 0 : POLLIN);
                waits.push_back({events ? to_rank_[r].fd() : -1, short(events), 0});
            }
            const auto is_done = [](const Transfer& array) { return array.is_done(); };
            if (std::all_of(sends.begin(), sends.end(), is_done) &&
                std::all_of(receives.begin(), receives.end(), is_done))
                return;
            ::poll(waits.data(), waits.size(), -1);
            for (std::size_t r = 0; r < out.size(); ++r) ready[r] = waits[r + 1].revents;
        }
    }

    void send(std::size_t to, Transfer& array) {
        const ssize_t sent = array.advance(
            [&](const msghdr& message) { return ::sendmsg(to_rank_[to].fd(), &message, MSG_NOSIGNAL | MSG_DONTWAIT); });
        if (sent < 0) check(to);
    }
    void receive(std::size_t from, Transfer& array, Size expected) {
        const ssize_t received =
            array.advance([&](msghdr& message) { return ::recvmsg(to_rank_[from].fd(), &message, MSG_DONTWAIT); });
        if (received < 0) check(from);
        if (received == 0) throw DeviceError("rank " + std::to_string(from) + " has closed the connection");
        if (array.has_size() && array.header() != expected)
            throw DeviceError("rank " + std::to_string(from) + " has sent " + std::to_string(array.header()) +
                              " bytes where " + std::to_string(expected) + " were expected");
    }
    /// Throws unless errno says that a later try may succeed.
    void check(std::size_t other) const {
        if (errno != EAGAIN && errno != EINTR)
            throw DeviceError("the connection to rank " + std::to_string(other) + " is lost: " + std::strerror(errno));
    }

    const std::vector<Descriptor> to_rank_;
    const Descriptor wake_;
    std::atomic<bool> aborted_ = false;
};

}  // namespace

std::unique_ptr<Communicator> connect_by_sockets(int rank, std::vector<Descriptor> to_rank) {
    return std::make_unique<SocketCommunicator>(rank, std::move(to_rank));
}

}  // namespace gs
