// SPDX-License-Identifier: Apache-2.0
// Serves a folder over HTTP to a browser on the same machine.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace gs {

/// A request that a WebHandler may answer. It comes from this machine, by a name of this machine, and has no body.
struct WebRequest {
    std::string method, path;                  ///< GET, HEAD or POST; decoded, without the query
    std::map<std::string, std::string> query;  ///< decoded
    std::string token;                         ///< the field X-Gsapp-Token, which pages of other sites cannot send
};

/// The answer to a WebRequest: a text, a file, or the address to go to instead.
struct WebAnswer {
    int status = 200;
    std::string type = "application/json", text = {};
    std::filesystem::path file = {};  ///< where it is not empty, its bytes are the answer, also in ranges
    std::string location = {};        ///< with status 302
    std::shared_ptr<void> held = {};  ///< kept until the file was sent
};

/// Answers what is no file of the folder; empty for what is. Called by several threads.
using WebHandler = std::function<std::optional<WebAnswer>(const WebRequest&)>;

/// Serves the regular files of one folder on 127.0.0.1, read only; "/" is index.html. Nothing outside the folder is
/// served: a path that leads out of it (by "..", an absolute path or a symbolic link) is answered 404, like a missing
/// file. Pages of other sites cannot read the files, except that the paper's viewer can read .ngsplat files: requests
/// to another host than localhost are refused (421), because a site can make its own name mean 127.0.0.1.
/// Each connection has a thread of its own, so that clients that wait or are slow delay no others.
class FileServer {
  public:
    /// Binds `port`, or any free one for 0. `handler` is asked first, and may also take POST requests. Throws
    /// UsageError when `folder` is no folder, DataError when the port is taken.
    FileServer(const std::filesystem::path& folder, int port, WebHandler handler = {});
    ~FileServer();

    int port() const { return port_; }
    /// Answers requests until stop() is called, by another thread or before, or with `until_interrupted` a signal
    /// arrives (interrupted()); then ends all connections. Throws DataError when the system lets it accept no more
    /// connections.
    void run(bool until_interrupted = true);
    void stop();

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
    int port_ = 0;
};

}  // namespace gs
