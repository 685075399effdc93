// SPDX-License-Identifier: Apache-2.0
// A folder over HTTP, for a browser on the same machine.
#pragma once

#include <filesystem>
#include <memory>

namespace gs {

/// Serves the regular files of one folder on 127.0.0.1, read only; "/" is index.html. Nothing outside the folder is served: a path that
/// leads out of it, by "..", by being absolute or by a symbolic link, is answered 404 like one that does not exist. Pages of other sites
/// cannot read what is served, but the paper's viewer can read .ngsplat files.
class FileServer {
  public:
    /// Binds `port`, or any free one for 0. Throws UsageError when `folder` is no folder, DataError when the port is taken.
    FileServer(const std::filesystem::path& folder, int port);
    ~FileServer();

    int port() const { return port_; }
    /// Answers requests until stop(), called from another thread.
    void run();
    void stop();

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
    int port_ = 0;
};

}  // namespace gs
