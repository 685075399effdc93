// SPDX-License-Identifier: Apache-2.0
// An open file, pipe or socket, which its owner closes on destruction.
#pragma once

#include <unistd.h>

#include <utility>

namespace gs {

class Descriptor {
  public:
    explicit Descriptor(int fd = -1) : fd_(fd) {}
    Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
        std::swap(fd_, other.fd_);
        return *this;
    }
    ~Descriptor() { close(); }
    /// Returns the system's file descriptor, negative if nothing is open.
    int fd() const { return fd_; }
    bool is_open() const { return fd_ >= 0; }
    void close() {
        if (const int fd = std::exchange(fd_, -1); fd >= 0) ::close(fd);
    }

  private:
    int fd_;
};

}  // namespace gs
