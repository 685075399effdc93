// SPDX-License-Identifier: Apache-2.0
// Serves a folder over HTTP to a browser on the same machine.
#pragma once

#include <filesystem>
#include <memory>

namespace gs {

/// Serves the regular files of one folder on 127.0.0.1, read only; "/" is index.html. Nothing outside the folder is
/// served: a path that leads out of it (by "..", an absolute path or a symbolic link) is answered 404, like a missing
/// file. Pages of other sites cannot read the files, except that the paper's viewer can read .ngsplat files: requests
/// to another host than localhost are refused (421), because a site can make its own name mean 127.0.0.1.
/// Each connection has a thread of its own, so that clients that wait or are slow delay no others.
class FileServer {
  public:
    /// Binds `port`, or any free one for 0. Throws UsageError when `folder` is no folder, DataError when the port is
    /// taken.
    FileServer(const std::filesystem::path& folder, int port);
    ~FileServer();

    int port() const { return port_; }
    /// Answers requests until stop() is called, by another thread or before, or a signal arrives (interrupted()); then
    /// ends all connections. Throws DataError when the system lets it accept no more connections.
    void run();
    void stop();

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
    int port_ = 0;
};

}  // namespace gs
