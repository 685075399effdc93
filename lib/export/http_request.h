// SPDX-License-Identifier: Apache-2.0
// Reads the head of an HTTP/1.x request (RFC 9112) and its Range field (RFC 9110, section 14).
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>

namespace gs {

/// The longest request line and the longest head (request line and fields), bytes.
constexpr std::size_t kMaxRequestLine = 8192, kMaxRequestHead = 16384;

struct HttpRequest {
    std::string method;                         ///< as sent; methods are case-sensitive
    std::string path;                           ///< percent-decoded, without query; may hold "..", and any byte
    std::string host;                           ///< as sent, with its port
    std::map<std::string, std::string> fields;  ///< by name in lower case; values of repeated fields joined by ", "
    bool keep_alive = true;                     ///< the connection may carry another request
};

/// A request that is answered with an error: the status and a sentence for the user.
struct HttpRefusal {
    int status = 400;
    std::string sentence;
};

/// Returns the length of the head at the start of `bytes`, its final empty line included, or 0 while it is incomplete.
/// Throws HttpRefusal (414, 431) for what exceeds the limits.
std::size_t http_head_length(std::string_view bytes);

/// Reads a complete head. Throws HttpRefusal: 400 for what is no request, 505 for other versions.
HttpRequest parse_http_request(std::string_view head);

/// Returns true for `localhost`, `127.0.0.1` and `[::1]`, alone or with a port. The port may be another one than the
/// server's: a tunnel to another machine has its own.
bool is_local_host(std::string_view host);

/// Bytes `first` to `first + length - 1` of a file.
struct ByteRange {
    std::uint64_t first = 0, length = 0;
};

enum class RangeKind {
    kWhole,          ///< no range, or one that RFC 9110 lets a server ignore: malformed, or several
    kPart,           ///< one range, cut to the file
    kNotSatisfiable  ///< one range that holds no byte of the file
};

/// Reads the value of a Range field for a file of `size` bytes. Writes `range` for kPart.
RangeKind parse_byte_range(std::string_view value, std::uint64_t size, ByteRange& range);

}  // namespace gs
