// SPDX-License-Identifier: Apache-2.0
// One client of the file server.
#pragma once

#include <poll.h>

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>

#include "lib/export/file_descriptor.h"
#include "lib/export/file_server.h"
#include "lib/export/http_answer.h"

namespace gs {

/// Answers the requests of one client without ever waiting for it.
class HttpConnection {
  public:
    using Clock = std::chrono::steady_clock;

    /// `socket` is non-blocking; `root` and `limits` outlive the connection.
    HttpConnection(FileDescriptor socket, const std::filesystem::path& root, const ServerLimits& limits)
        : socket_(std::move(socket)), root_(root), limits_(limits), deadline_(Clock::now() + limits.head) {}

    int socket() const { return socket_.get(); }
    /// What poll() must wait for.
    short events() const { return is_sending() ? POLLOUT : POLLIN; }
    /// When the connection ends unless something happens; arriving bytes do not move it.
    Clock::time_point deadline() const { return deadline_; }
    bool is_sending() const { return state_ == State::kSending; }

    /// Does what can be done without waiting. Returns false when the connection is over.
    bool advance();

  private:
    enum class State {
        kReading,  ///< waits for a whole request
        kSending,  ///< answers it
        kLeaving   ///< has answered; what the client still sends is read, else its system could discard the answer
    };

    bool read();
    /// Prepares the answer when `input_` holds a whole request or can become none.
    void take_request();
    bool send();
    bool finish();

    FileDescriptor socket_;
    const std::filesystem::path& root_;
    const ServerLimits& limits_;
    State state_ = State::kReading;
    Clock::time_point deadline_;
    std::string input_;
    HttpAnswer answer_;
    std::size_t sent_ = 0;  ///< bytes of the answer
};

}  // namespace gs
