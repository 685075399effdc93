// SPDX-License-Identifier: Apache-2.0
// Serves a folder over HTTP to a browser on the same machine.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>

namespace gs {

/// What one client may cost the others. A connection has one deadline at a time, which no trickle of bytes extends.
struct ServerLimits {
    int connections = 256;                  ///< beyond these, the one that has waited longest for a request is dropped
    std::chrono::milliseconds head{10000};  ///< for a whole request to arrive, idle time before it included
    std::chrono::milliseconds send{30000};  ///< for an answer to leave, beside what its size takes at `rate`
    std::int64_t rate = 65536;              ///< bytes/s that a client must take in on average
};

/// Serves the regular files of one folder on 127.0.0.1, read only; "/" is index.html. Nothing outside the folder is
/// served: a path that leads out of it (by "..", an absolute path or a symbolic link) is answered 404, like a missing
/// file. Pages of other sites cannot read the files, except that the paper's viewer can read .ngsplat files: requests
/// to another host than localhost are refused (421), because a site can make its own name mean 127.0.0.1.
/// One thread serves all clients, and waits for none of them.
class FileServer {
  public:
    /// Binds `port`, or any free one for 0. Throws UsageError when `folder` is no folder, DataError when the port is
    /// taken.
    FileServer(const std::filesystem::path& folder, int port, const ServerLimits& limits = {});
    ~FileServer();

    int port() const { return port_; }
    /// Answers requests until stop() is called, by another thread or before, or a signal arrives (interrupted()).
    void run();
    void stop();

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
    int port_ = 0;
};

}  // namespace gs
