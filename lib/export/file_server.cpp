// SPDX-License-Identifier: Apache-2.0
// Serves all clients from one loop over poll(): what would wait is left until the socket is ready.
#include "lib/export/file_server.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <list>
#include <vector>

#include "kernels/core/error.h"
#include "lib/core/interrupt.h"
#include "lib/export/http_connection.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

using Clock = HttpConnection::Clock;
using std::chrono::milliseconds;

/// The longest sleep: a signal that arrives just before the sleep does not end it.
constexpr milliseconds kLongestSleep(500);
/// The most clients accepted before those that are connected have their turn again.
constexpr int kAcceptedAtOnce = 64;

FileDescriptor listen_on(int port) {
    FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int yes = 1;
    ::setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    sockaddr_in address = {};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
        ::listen(socket.get(), SOMAXCONN) != 0)
        throw DataError(
            fmt::format("port {} cannot be used; another program may have it. Choose another port with --port", port));
    return socket;
}

int port_of(const FileDescriptor& socket) {
    sockaddr_in address = {};
    socklen_t size = sizeof address;
    ::getsockname(socket.get(), reinterpret_cast<sockaddr*>(&address), &size);
    return ntohs(address.sin_port);
}

}  // namespace

struct FileServer::Implementation {
    fs::path root;
    ServerLimits limits;
    FileDescriptor listener;
    FileDescriptor wake_read, wake_write;  ///< a byte in this pipe ends the loop
    std::list<HttpConnection> connections;

    /// Drops the connection whose deadline is next among those that wait for a request, or among all if none does.
    void drop_one() {
        const auto victim = std::min_element(
            connections.begin(), connections.end(), [](const HttpConnection& a, const HttpConnection& b) {
                return std::pair(a.is_sending(), a.deadline()) < std::pair(b.is_sending(), b.deadline());
            });
        if (victim != connections.end()) connections.erase(victim);
    }

    void accept_clients() {
        for (int i = 0; i < kAcceptedAtOnce; ++i) {
            FileDescriptor socket(::accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
            if (!socket.is_open()) {
                if (errno == EMFILE || errno == ENFILE) drop_one();  // so that the next turn has a descriptor
                return;
            }
            if (int(connections.size()) >= limits.connections) drop_one();
            connections.emplace_back(std::move(socket), root, limits);
            if (!connections.back().advance()) connections.pop_back();
        }
    }

    /// Waits until something is ready and does it. Returns false when the server was stopped.
    bool turn() {
        auto next = Clock::now() + kLongestSleep;
        std::vector<pollfd> ready = {{wake_read.get(), POLLIN, 0}, {listener.get(), POLLIN, 0}};
        for (const HttpConnection& c : connections) {
            ready.push_back({c.socket(), c.events(), 0});
            next = std::min(next, c.deadline());
        }
        const auto sleep = std::chrono::ceil<milliseconds>(std::max(next - Clock::now(), Clock::duration(0)));
        if (::poll(ready.data(), ready.size(), int(sleep.count())) < 0) return true;  // a signal; no field is set
        if (ready[0].revents) return false;
        std::size_t i = 2;
        for (auto it = connections.begin(); it != connections.end(); ++i) {
            const bool over = (ready[i].revents && !it->advance()) || it->deadline() <= Clock::now();
            it = over ? connections.erase(it) : std::next(it);
        }
        if (ready[1].revents) accept_clients();
        return true;
    }
};

FileServer::FileServer(const fs::path& folder, int port, const ServerLimits& limits)
    : implementation_(std::make_unique<Implementation>()) {
    std::error_code error;
    Implementation& server = *implementation_;
    server.root = fs::canonical(folder, error);
    if (error || !fs::is_directory(server.root, error))
        throw UsageError(fmt::format("'{}' is not a folder; gsapp export RUN -o DIR makes one", folder.string()));
    server.limits = limits;
    server.listener = listen_on(port);
    port_ = port_of(server.listener);
    int ends[2];
    if (::pipe2(ends, O_CLOEXEC | O_NONBLOCK) != 0) throw DataError("no pipe can be opened; too many files are open");
    server.wake_read = FileDescriptor(ends[0]);
    server.wake_write = FileDescriptor(ends[1]);
}

FileServer::~FileServer() = default;

void FileServer::run() {
    while (!interrupted() && implementation_->turn()) {
    }
    implementation_->connections.clear();
}

void FileServer::stop() { [[maybe_unused]] const ssize_t written = ::write(implementation_->wake_write.get(), "", 1); }

}  // namespace gs
