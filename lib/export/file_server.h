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

/// A request that a WebHandler may answer. It comes from this machine, is addressed to a name of this machine, and has
/// no body.
struct WebRequest {
    std::string method, path;                  ///< GET, HEAD or POST; decoded, without the query
    std::map<std::string, std::string> query;  ///< decoded
    std::string token;                         ///< header X-Gsapp-Token, which pages of other sites cannot send
};

/// The answer to a WebRequest: a text, a file, or a redirect address.
struct WebAnswer {
    int status = 200;
    std::string type = "application/json", text = {};
    std::filesystem::path file = {};  ///< if not empty, the answer is its bytes, or a range of them
    std::string location = {};        ///< redirect address, with status 302
    std::shared_ptr<void> held = {};  ///< object kept alive until the file is sent
};

/// Answers requests for anything but the folder's files, for which it returns nothing. Called by several threads.
using WebHandler = std::function<std::optional<WebAnswer>(const WebRequest&)>;

/// Serves the regular files of one folder on 127.0.0.1, read only; "/" is index.html. Nothing outside the folder is
/// served: a path that leads out of it (by "..", an absolute path or a symbolic link) is answered 404, like a missing
/// file. Pages of other sites cannot read the files, except that the paper's viewer can read .ngsplat files. Requests
/// with a host other than localhost are refused (421), because a site can resolve its own name to 127.0.0.1. Each
/// connection has its own thread, so that waiting or slow clients do not delay others.
class FileServer {
  public:
    /// Binds `port`, or any free port for 0. `handler` is called first and may also answer POST requests. Throws
    /// UsageError if `folder` is not a folder, DataError if the port is taken.
    FileServer(const std::filesystem::path& folder, int port, WebHandler handler = {});
    ~FileServer();

    int port() const { return port_; }
    /// Answers requests until stop() is called, by another thread or earlier, or, with `until_interrupted`, until a
    /// signal arrives (interrupted()); then ends all connections. Throws DataError if the system refuses to accept more
    /// connections.
    void run(bool until_interrupted = true);
    void stop();

  private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
    int port_ = 0;
};

}  // namespace gs
