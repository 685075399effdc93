// SPDX-License-Identifier: Apache-2.0
// Serves a folder over HTTP with cpp-httplib.
#include "lib/export/file_server.h"

#include <fmt/format.h>
#include <httplib.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <future>
#include <list>
#include <map>
#include <optional>
#include <regex>
#include <system_error>
#include <thread>
#include <utility>

#include "kernels/base/error.h"
#include "lib/core/interrupt.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

using std::chrono::milliseconds;

/// The largest part of a file held in memory, bytes.
constexpr std::size_t kChunk = 1 << 20;
/// The largest number of connections served at once; others wait. It is below the usual limit of 1024 open files.
constexpr std::size_t kMaxConnections = 800;
/// The interval at which the conditions that end the server are checked.
constexpr milliseconds kLook(20);
/// The only other site whose pages may read scenes: the paper's viewer (docs/formats.md).
constexpr const char* kPaperViewer = "https://fhahlbohm.github.io";

/// Runs each connection in its own thread. The library's own pool has only a few threads, which idle clients would
/// occupy.
class ThreadForEach : public httplib::TaskQueue {
  public:
    void enqueue(std::function<void()> serve) override {
        for (;; std::this_thread::sleep_for(milliseconds(5))) {
            running_.remove_if(
                [](const auto& one) { return one.wait_for(milliseconds(0)) == std::future_status::ready; });
            if (running_.size() >= kMaxConnections) continue;
            try {
                running_.push_back(std::async(std::launch::async, serve));
                return;
            } catch (const std::system_error&) {  // the system has no more threads: wait until one ends
            }
        }
    }
    void shutdown() override { running_.clear(); }  // joins the threads

  private:
    std::list<std::future<void>> running_;
};

/// Ends all connections of this process at `port`. It searches the open files, because the library does not expose its
/// sockets. On stopping, the library waits until each client has ended or timed out, which never happens for a client
/// that sends a byte now and then.
void end_connections(int port) {
    std::error_code error;
    for (fs::directory_iterator it("/proc/self/fd", error), end; !error && it != end; it.increment(error)) {
        const int socket = std::atoi(it->path().filename().c_str());
        sockaddr_in address = {};
        socklen_t size = sizeof address;
        if (::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0 && address.sin_family == AF_INET &&
            ntohs(address.sin_port) == port)
            ::shutdown(socket, SHUT_RDWR);
    }
}

const char* content_type(const fs::path& file) {
    static const std::map<std::string, const char*> types = {
        {".html", "text/html; charset=utf-8"},
        {".js", "text/javascript"},
        {".css", "text/css"},
        {".json", "application/json"},
        {".txt", "text/plain; charset=utf-8"},
        {".svg", "image/svg+xml"},
        {".png", "image/png"},
        {".jpg", "image/jpeg"},
    };
    const auto known = types.find(file.extension().string());
    return known == types.end() ? "application/octet-stream" : known->second;  // .ngsplat, .ply, .splat
}

/// Returns the file of a decoded request path, with links resolved, or nothing for a path outside of `root`, which must
/// be canonical.
std::optional<fs::path> served_file(const fs::path& root, const std::string& request_path) {
    const fs::path relative = fs::path(request_path).relative_path();
    if (request_path.find('\0') != std::string::npos) return std::nullopt;
    std::error_code error;
    const fs::path file = fs::canonical(root / (relative.empty() ? fs::path("index.html") : relative), error);
    if (error || !fs::is_regular_file(file, error)) return std::nullopt;
    const fs::path inside = file.lexically_relative(root);
    return inside.empty() || *inside.begin() == ".." ? std::nullopt : std::optional(file);
}

/// Keeps the range that the library should answer, clipped to a file of `size` bytes. As RFC 9110 allows, ignores
/// several ranges, and ranges with If-Range, because no answer has a validator. Returns false for a range without
/// bytes.
bool keep_one_range(httplib::Request& request, ssize_t size) {
    const httplib::Ranges ranges = std::exchange(request.ranges, {});
    if (request.method != "GET" || request.has_header("If-Range") || ranges.size() != 1) return true;
    auto [first, last] = ranges[0];  // -1: not there
    if (first == -1) {               // the last `last` bytes
        if (last == -1 || (size == 0 && last > 0)) return true;
        first = size - std::min(std::exchange(last, -1), size);
    }
    if (first >= size) return false;
    request.ranges = {{first, last == -1 ? size - 1 : std::min(last, size - 1)}};
    return true;
}

/// Returns the error status if the request must be refused, else 0.
int refusal(const httplib::Request& request) {
    // Any port is accepted, because a tunnel to another machine has its own port.
    static const std::regex local(R"((localhost|127\.0\.0\.1|\[::1\])(:\d{0,5})?)", std::regex::icase);
    if (request.get_header_value_count("Host") != 1) return 400;
    return std::regex_match(request.get_header_value("Host"), local) ? 0 : 421;
}

/// Answers with a file, or a range of it. Returns the status. The body of an error is added later.
int answer_file(const std::optional<fs::path>& file, const std::shared_ptr<void>& held, httplib::Request& request,
                httplib::Response& response) {
    const auto stream = std::make_shared<std::ifstream>();
    if (file) stream->open(*file, std::ios::binary | std::ios::ate);
    // The size of the open file: a training may have replaced the file at this path since.
    const std::streamoff size = file ? std::streamoff(stream->tellg()) : -1;
    if (size < 0) return 404;
    if (!keep_one_range(request, ssize_t(size))) {
        response.set_header("Content-Range", fmt::format("bytes */{}", size));
        return 416;
    }
    response.set_header("Accept-Ranges", "bytes");
    response.set_header("Cache-Control", "no-store");  // the next export may write another scene to the same address
    if (file->extension() == ".ngsplat") response.set_header("Access-Control-Allow-Origin", kPaperViewer);
    if (size == 0) {
        response.set_content("", content_type(*file));
        return 200;
    }
    response.set_content_provider(std::size_t(size), content_type(*file),
                                  [stream, held](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                                      std::string bytes(std::min(length, kChunk), '\0');
                                      stream->seekg(std::streamoff(offset));
                                      return bool(stream->read(bytes.data(), std::streamsize(bytes.size()))) &&
                                             sink.write(bytes.data(), bytes.size());
                                  });
    return request.ranges.empty() ? 200 : 206;
}

/// Returns the handler's answer, if the request may be passed to a handler.
std::optional<WebAnswer> handled(const WebHandler& handler, const httplib::Request& request) {
    const bool has_body = request.has_header("Transfer-Encoding") ||
                          (request.has_header("Content-Length") && request.get_header_value("Content-Length") != "0");
    const bool known = request.method == "GET" || request.method == "HEAD" || request.method == "POST";
    if (!handler || !known || has_body) return std::nullopt;
    WebRequest web{request.method, request.path, {}, request.get_header_value("X-Gsapp-Token")};
    web.query.insert(request.params.begin(), request.params.end());
    return handler(web);
}

/// Answers a request by the handler, or with a file in `root`, which must be canonical. Returns the status. The body of
/// an error is added later.
int answer(const fs::path& root, const WebHandler& handler, httplib::Request& request, httplib::Response& response) {
    if (const int status = refusal(request)) return status;
    if (const auto web = handled(handler, request)) {
        if (!web->file.empty()) return answer_file(web->file, web->held, request, response);
        request.ranges.clear();
        response.set_header("Cache-Control", "no-store");
        if (!web->location.empty()) response.set_header("Location", web->location);
        if (web->status < 400) response.set_content(web->text, web->type);
        return web->status;
    }
    if (request.method != "GET" && request.method != "HEAD") return 405;
    return answer_file(served_file(root, request.path), nullptr, request, response);
}

/// Sets the body of an error and ends the connection. Otherwise an unread request body would be parsed as the next
/// request, and a page of another site could bypass the check of the host.
void refuse(httplib::Request& request, httplib::Response& response) {
    static const std::map<int, std::string> sentences = {
        {400, "this is no request for a file"},
        {403, "only the page whose address gsapp printed may do this"},
        {404, "not found"},
        {405, "files are only read here, by GET and HEAD"},
        {414, "the address is too long"},
        {416, "the file has no byte in this range"},
        {421, "this server answers for localhost, 127.0.0.1 and [::1] alone, not for another host"},
    };
    const auto known = sentences.find(response.status);
    const std::string body = (known == sentences.end() ? "the request failed" : known->second) + "\n";
    request.ranges.clear();
    response.set_header("Connection", "close");
    if (response.status == 405) response.set_header("Allow", "GET, HEAD");
    response.set_content_provider(body.size(), "text/plain", [body](std::size_t, std::size_t, httplib::DataSink& sink) {
        sink.write(body.data(), body.size());
        return false;  // ends the connection
    });
}

}  // namespace

struct FileServer::Implementation {
    httplib::Server server;
    socket_t listener = INVALID_SOCKET;
    std::atomic<bool> stopped = false;
};

FileServer::FileServer(const fs::path& folder, int port, WebHandler handler)
    : implementation_(std::make_unique<Implementation>()) {
    std::error_code error;
    const fs::path root = fs::canonical(folder, error);
    if (error || !fs::is_directory(root, error))
        throw UsageError(fmt::format("'{}' is not a folder; gsapp export RUN -o DIR makes one", folder.string()));
    httplib::Server& server = implementation_->server;
    // Replaces the library's own socket options, which would let two servers share a port.
    server.set_socket_options([this](socket_t socket) {
        const int yes = 1;
        ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        implementation_->listener = socket;
    });
    server.new_task_queue = [] { return new ThreadForEach; };
    server.set_tcp_nodelay(true);
    server.set_keep_alive_max_count(1000);
    server.set_keep_alive_timeout(2);  // s; a waiting thread polls its socket a hundred times a second
    server.set_write_timeout(30);      // s; a page may be busy with the data received so far
    // The library passes its own mutable request as const, and later answers according to its ranges.
    server.set_pre_routing_handler([root, handler](const httplib::Request& request, httplib::Response& response) {
        response.status = answer(root, handler, const_cast<httplib::Request&>(request), response);
        return httplib::Server::HandlerResponse::Handled;
    });
    server.set_error_handler([root, handler](const httplib::Request& constant, httplib::Response& response) {
        auto& request = const_cast<httplib::Request&>(constant);
        // The library refuses ranges that it cannot parse. RFC 9110, 14.2 requires to ignore them.
        if (response.status == 416 && !response.has_header("Content-Range")) {
            request.ranges.clear();
            response.status = answer(root, handler, request, response);
        }
        if (response.status >= 400) refuse(request, response);
    });
    constexpr const char* kHost = "127.0.0.1";
    port_ = port == 0 ? server.bind_to_any_port(kHost) : (server.bind_to_port(kHost, port) ? port : -1);
    if (port_ < 0)
        throw DataError(
            fmt::format("port {} cannot be used; another program may have it. Choose another port with --port", port));
    ::listen(implementation_->listener, SOMAXCONN);  // the library's own backlog is five clients
}

FileServer::~FileServer() = default;

void FileServer::run(bool until_interrupted) {
    httplib::Server& server = implementation_->server;
    const std::jthread watcher([&](const std::stop_token& done) {
        for (; !done.stop_requested(); std::this_thread::sleep_for(kLook)) {
            if (!server.is_running() || !(implementation_->stopped || (until_interrupted && interrupted()))) continue;
            server.stop();
            end_connections(port_);
            return;
        }
    });
    if (!server.listen_after_bind())
        throw DataError(fmt::format("port {} accepts no more connections; start gsapp view again", port_));
}

void FileServer::stop() { implementation_->stopped = true; }

}  // namespace gs
