// SPDX-License-Identifier: Apache-2.0
// Finds the file of a request and writes the head of its answer.
#include "lib/export/http_answer.h"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <ctime>
#include <map>
#include <optional>

namespace gs {

namespace fs = std::filesystem;
namespace {

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

const char* reason_of(int status) {
    switch (status) {
        case 200:
            return "OK";
        case 206:
            return "Partial Content";
        case 400:
            return "Bad Request";
        case 404:
            return "Not Found";
        case 405:
            return "Method Not Allowed";
        case 414:
            return "URI Too Long";
        case 416:
            return "Range Not Satisfiable";
        case 421:
            return "Misdirected Request";
        case 431:
            return "Request Header Fields Too Large";
        case 505:
            return "HTTP Version Not Supported";
        default:
            return "Error";
    }
}

/// Returns the file of a decoded request path, with links resolved; nothing for a path outside of `root`.
std::optional<fs::path> served_file(const fs::path& root, const std::string& request_path) {
    if (request_path.find('\0') != std::string::npos) return std::nullopt;
    const fs::path relative = fs::path(request_path).relative_path();
    std::error_code error;
    const fs::path file = fs::canonical(root / (relative.empty() ? fs::path("index.html") : relative), error);
    if (error || !fs::is_regular_file(file, error)) return std::nullopt;
    const fs::path inside = file.lexically_relative(root);
    return inside.empty() || *inside.begin() == ".." ? std::nullopt : std::optional(file);
}

/// Opens a regular file and finds its size, bytes; a closed descriptor where that is impossible. What took the file's
/// place since its path was looked at is not waited for (a pipe) or followed (a link).
FileDescriptor open_file(const fs::path& path, std::uint64_t& size) {
    FileDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    struct stat status = {};
    if (!file.is_open() || ::fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode)) return FileDescriptor();
    size = std::uint64_t(status.st_size);
    return file;
}

/// `fields` are whole lines, "Name: value\r\n" each.
std::string head_of(int status, std::uint64_t length, bool keep_alive, const std::string& fields) {
    return fmt::format(
        "HTTP/1.1 {} {}\r\nDate: {:%a, %d %b %Y %H:%M:%S} GMT\r\nContent-Length: {}\r\nConnection: {}\r\n{}\r\n",
        status, reason_of(status), fmt::gmtime(std::time(nullptr)), length, keep_alive ? "keep-alive" : "close",
        fields);
}

HttpAnswer short_answer(int status, const std::string& sentence, bool with_body, bool keep_alive,
                        const std::string& fields = "") {
    const std::string body = sentence + "\n";
    HttpAnswer answer;
    answer.head = head_of(status, body.size(), keep_alive, "Content-Type: text/plain; charset=utf-8\r\n" + fields);
    if (with_body) answer.head += body;
    answer.keep_alive = keep_alive;
    return answer;
}

}  // namespace

HttpAnswer answer_request(const fs::path& root, const HttpRequest& request) {
    const bool with_body = request.method != "HEAD";
    const auto refuse = [&](int status, const std::string& sentence, const std::string& fields = "") {
        return short_answer(status, sentence, with_body, request.keep_alive, fields);
    };
    if (!is_local_host(request.host))
        return refuse(421, "this server answers for localhost, 127.0.0.1 and [::1] alone, not for another host");
    if (request.method != "GET" && request.method != "HEAD")
        return refuse(405, "files are only read here, by GET and HEAD", "Allow: GET, HEAD\r\n");
    const auto path = served_file(root, request.path);
    std::uint64_t size = 0;
    HttpAnswer answer;
    if (path) answer.file = open_file(*path, size);
    if (!answer.file.is_open()) return refuse(404, "not found");

    // The next export may put another scene at the same address.
    std::string fields =
        fmt::format("Content-Type: {}\r\nCache-Control: no-store\r\nAccept-Ranges: bytes\r\n", content_type(*path));
    if (path->extension() == ".ngsplat") fields += fmt::format("Access-Control-Allow-Origin: {}\r\n", kPaperViewer);
    const auto wanted = request.fields.find("range");
    // No answer carries a validator, so that whatever If-Range names is not this file.
    const bool has_range =
        request.method == "GET" && wanted != request.fields.end() && !request.fields.contains("if-range");
    ByteRange range;
    const RangeKind kind = has_range ? parse_byte_range(wanted->second, size, range) : RangeKind::kWhole;
    if (kind == RangeKind::kNotSatisfiable)
        return refuse(416, fmt::format("the file has {} bytes, none of which is in the range", size),
                      fmt::format("Content-Range: bytes */{}\r\n", size));
    if (kind == RangeKind::kWhole) range = {0, size};
    if (kind == RangeKind::kPart)
        fields += fmt::format("Content-Range: bytes {}-{}/{}\r\n", range.first, range.first + range.length - 1, size);
    answer.head = head_of(kind == RangeKind::kPart ? 206 : 200, range.length, request.keep_alive, fields);
    answer.first = range.first;
    answer.length = with_body ? range.length : 0;
    answer.keep_alive = request.keep_alive;
    return answer;
}

HttpAnswer answer_refusal(const HttpRefusal& refusal) {
    return short_answer(refusal.status, refusal.sentence, true, false);
}

}  // namespace gs
