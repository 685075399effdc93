// SPDX-License-Identifier: Apache-2.0
// Reads and sends as far as the socket is ready.
#include "lib/export/http_connection.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <string_view>

namespace gs {

using std::chrono::milliseconds;
namespace {

/// The largest piece of a file held in memory, and what one client gets before the next has its turn, bytes.
constexpr std::size_t kChunk = 1 << 16, kTurn = 1 << 20;
/// How long a client may take to notice that its connection ends.
constexpr milliseconds kFarewell(2000);

bool would_wait() { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

}  // namespace

bool HttpConnection::advance() {
    switch (state_) {
        case State::kReading:
            return read();
        case State::kSending:
            return send();
        case State::kLeaving:
            break;
    }
    std::array<char, 4096> ignored;
    const ssize_t n = ::recv(socket(), ignored.data(), ignored.size(), 0);
    return n > 0 || (n < 0 && would_wait());
}

bool HttpConnection::read() {
    std::array<char, 4096> bytes;
    const ssize_t n = ::recv(socket(), bytes.data(), bytes.size(), 0);
    if (n <= 0) return n < 0 && would_wait();
    input_.append(bytes.data(), std::size_t(n));
    take_request();
    return true;
}

void HttpConnection::take_request() {
    input_.erase(0, std::min(input_.find_first_not_of("\r\n"), input_.size()));  // RFC 9112, 2.2
    try {
        const std::size_t length = http_head_length(input_);
        if (length == 0) return;
        answer_ = answer_request(root_, parse_http_request(std::string_view(input_).substr(0, length)));
        input_.erase(0, length);
    } catch (const HttpRefusal& refusal) {
        answer_ = answer_refusal(refusal);
    }
    sent_ = 0;
    state_ = State::kSending;
    deadline_ = Clock::now() + limits_.send + milliseconds(std::int64_t(answer_.length) / limits_.rate * 1000);
}

bool HttpConnection::send() {
    for (std::size_t turn = 0; turn < kTurn;) {
        if (sent_ == answer_.head.size() + answer_.length) return finish();
        std::array<char, kChunk> chunk;
        std::string_view bytes = std::string_view(answer_.head).substr(std::min(sent_, answer_.head.size()));
        if (bytes.empty()) {
            const std::uint64_t done = sent_ - answer_.head.size();
            const ssize_t n = ::pread(answer_.file.get(), chunk.data(), std::min(kChunk, answer_.length - done),
                                      off_t(answer_.first + done));
            if (n <= 0) return false;  // the file became shorter; the client sees that bytes are missing
            bytes = {chunk.data(), std::size_t(n)};
        }
        const ssize_t n = ::send(socket(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
        if (n < 0) return would_wait();
        sent_ += std::size_t(n);
        turn += std::size_t(n);
    }
    return true;
}

bool HttpConnection::finish() {
    const bool keep_alive = answer_.keep_alive;
    answer_ = HttpAnswer();
    if (keep_alive) {
        state_ = State::kReading;
        deadline_ = Clock::now() + limits_.head;
        take_request();  // the next one may be here already
        return true;
    }
    state_ = State::kLeaving;
    deadline_ = Clock::now() + kFarewell;
    return ::shutdown(socket(), SHUT_WR) == 0;
}

}  // namespace gs
