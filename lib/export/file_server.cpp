// SPDX-License-Identifier: Apache-2.0
// Serves a folder over HTTP with cpp-httplib.
#include "lib/export/file_server.h"

#include <fmt/format.h>
#include <httplib.h>

#include <fstream>
#include <map>
#include <optional>

#include "kernels/core/error.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

/// The largest piece of a file held in memory, bytes.
constexpr std::size_t kChunk = 1 << 20;
/// The one other site whose pages may read scenes: the viewer of the paper (docs/formats.md).
constexpr const char* kPaperViewer = "https://fhahlbohm.github.io";

const char* content_type(const fs::path& file) {
    static const std::map<std::string, const char*> types = {
        {".html", "text/html; charset=utf-8"},
        {".js", "text/javascript"},
        {".css", "text/css"},
        {".json", "application/json"},
        {".txt", "text/plain; charset=utf-8"},
        {".svg", "image/svg+xml"},
        {".png", "image/png"},
    };
    const auto known = types.find(file.extension().string());
    return known == types.end() ? "application/octet-stream" : known->second;  // .ngsplat, .ply, .splat
}

/// Returns the file of a decoded request path, with links resolved; nothing for a path outside of `root`, which must be
/// canonical.
std::optional<fs::path> served_file(const fs::path& root, const std::string& request_path) {
    const fs::path relative = fs::path(request_path).relative_path();
    if (request_path.find('\0') != std::string::npos) return std::nullopt;
    std::error_code error;
    const fs::path file = fs::canonical(root / (relative.empty() ? fs::path("index.html") : relative), error);
    if (error || !fs::is_regular_file(file, error)) return std::nullopt;
    const fs::path inside = file.lexically_relative(root);
    return inside.empty() || *inside.begin() == ".." ? std::nullopt : std::optional(file);
}

void answer(const fs::path& root, const httplib::Request& request, httplib::Response& response) {
    const auto file = served_file(root, request.path);
    const auto stream = std::make_shared<std::ifstream>();
    if (file) stream->open(*file, std::ios::binary);
    if (!file || !*stream) {
        response.status = 404;
        response.set_content("not found\n", "text/plain");
        return;
    }
    response.set_header("Cache-Control", "no-store");  // the next export may put another scene at the same address
    if (file->extension() == ".ngsplat") response.set_header("Access-Control-Allow-Origin", kPaperViewer);
    const std::size_t size = std::size_t(fs::file_size(*file));
    if (size == 0) return response.set_content("", content_type(*file));
    response.set_content_provider(size, content_type(*file),
                                  [stream](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                                      std::string bytes(std::min(length, kChunk), '\0');
                                      stream->seekg(std::streamoff(offset));
                                      return bool(stream->read(bytes.data(), std::streamsize(bytes.size()))) &&
                                             sink.write(bytes.data(), bytes.size());
                                  });
}

}  // namespace

struct FileServer::Implementation {
    httplib::Server server;
};

FileServer::FileServer(const fs::path& folder, int port) : implementation_(std::make_unique<Implementation>()) {
    std::error_code error;
    const fs::path root = fs::canonical(folder, error);
    if (error || !fs::is_directory(root, error))
        throw UsageError(fmt::format("'{}' is not a folder; gsapp export RUN -o DIR makes one", folder.string()));
    httplib::Server& server = implementation_->server;
    // Replaces the library's own option, with which two servers would share a port.
    server.set_socket_options([](socket_t socket) {
        const int yes = 1;
        ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    server.Get(".*", [root](const httplib::Request& request, httplib::Response& response) {
        answer(root, request, response);
    });
    constexpr const char* kHost = "127.0.0.1";
    port_ = port == 0 ? server.bind_to_any_port(kHost) : (server.bind_to_port(kHost, port) ? port : -1);
    if (port_ < 0)
        throw DataError(
            fmt::format("port {} cannot be used; another program may have it. Choose another port with --port", port));
}

FileServer::~FileServer() = default;

void FileServer::run() { implementation_->server.listen_after_bind(); }
void FileServer::stop() { implementation_->server.stop(); }

}  // namespace gs
