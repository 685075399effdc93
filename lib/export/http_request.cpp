// SPDX-License-Identifier: Apache-2.0
// Reads requests strictly: what another reader could take in another way is refused.
#include "lib/export/http_request.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>

namespace gs {
namespace {

bool is_token(std::string_view text) {
    const auto allowed = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
               std::string_view("!#$%&'*+-.^_`|~").find(c) != std::string_view::npos;
    };
    return !text.empty() && std::all_of(text.begin(), text.end(), allowed);
}

std::string lower_case(std::string_view text) {
    std::string out(text);
    for (char& c : out)
        if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
    return out;
}

std::string_view without_blanks(std::string_view text) {
    const auto first = text.find_first_not_of(" \t");
    if (first == std::string_view::npos) return {};
    return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string percent_decoded(std::string_view text) {
    std::string out;
    for (std::size_t i = 0; i < text.size(); ++i) {
        if (text[i] != '%') {
            out += text[i];
            continue;
        }
        unsigned value = 0;
        const char* const end = text.data() + std::min(text.size(), i + 3);
        const auto [stop, error] = std::from_chars(text.data() + i + 1, end, value, 16);
        if (error != std::errc() || stop != text.data() + i + 3)
            throw HttpRefusal{400, "a '%' in the path is not followed by two hexadecimal digits"};
        out += char(value);
        i += 2;
    }
    return out;
}

/// Takes the line up to CR LF off the front of `head`.
std::string_view take_line(std::string_view& head) {
    const auto end = head.find("\r\n");
    const std::string_view line = head.substr(0, end);
    head.remove_prefix(end == std::string_view::npos ? head.size() : end + 2);
    return line;
}

/// Reads "GET /path?query HTTP/1.1", or a whole address in place of the path, whose host is then returned.
std::string read_request_line(std::string_view line, HttpRequest& request) {
    const auto after_method = line.find(' '), before_version = line.rfind(' ');
    if (after_method == before_version) throw HttpRefusal{400, "the request line is not METHOD PATH VERSION"};
    request.method = line.substr(0, after_method);
    std::string_view target = line.substr(after_method + 1, before_version - after_method - 1);
    const std::string_view version = line.substr(before_version + 1);
    if (!is_token(request.method)) throw HttpRefusal{400, "the method is not a word"};
    if (version != "HTTP/1.1" && version != "HTTP/1.0") {
        if (version.starts_with("HTTP/")) throw HttpRefusal{505, "only HTTP/1.1 and HTTP/1.0 are spoken here"};
        throw HttpRefusal{400, "the request line does not end with a version"};
    }
    request.keep_alive = version == "HTTP/1.1";
    std::string host;
    if (constexpr std::string_view kScheme = "http://"; lower_case(target.substr(0, kScheme.size())) == kScheme) {
        target.remove_prefix(kScheme.size());
        const auto end = std::min(target.find_first_of("/?"), target.size());
        host = target.substr(0, end);
        target.remove_prefix(end);
        if (host.empty()) throw HttpRefusal{400, "the address names no host"};
    } else if (!target.starts_with('/')) {
        throw HttpRefusal{400, "the path does not begin with '/'"};
    }
    request.path = percent_decoded(target.substr(0, target.find('?')));
    const auto is_odd = [](char c) { return static_cast<unsigned char>(c) <= ' ' || c == 0x7f; };
    if (std::any_of(target.begin(), target.end(), is_odd)) throw HttpRefusal{400, "the path holds a control character"};
    return host;
}

bool lists(std::string_view list, std::string_view word) {
    while (!list.empty()) {
        const auto end = std::min(list.find(','), list.size());
        if (lower_case(without_blanks(list.substr(0, end))) == word) return true;
        list.remove_prefix(std::min(end + 1, list.size()));
    }
    return false;
}

}  // namespace

std::size_t http_head_length(std::string_view bytes) {
    const auto line_end = bytes.find("\r\n");
    if (std::min(line_end, bytes.size()) > kMaxRequestLine)
        throw HttpRefusal{414, fmt::format("the request line is longer than {} bytes", kMaxRequestLine)};
    const auto end = bytes.find("\r\n\r\n");
    const std::size_t length = end == std::string_view::npos ? 0 : end + 4;
    if (std::max(length, length == 0 ? bytes.size() : 0) > kMaxRequestHead)
        throw HttpRefusal{431, fmt::format("the request's head is longer than {} bytes", kMaxRequestHead)};
    return length;
}

HttpRequest parse_http_request(std::string_view head) {
    HttpRequest request;
    const std::string host_of_address = read_request_line(take_line(head), request);
    while (!head.empty()) {
        const std::string_view line = take_line(head);
        if (line.empty()) break;
        const auto colon = line.find(':');
        if (colon == std::string_view::npos || !is_token(line.substr(0, colon)))
            throw HttpRefusal{400, "a header field is not NAME: VALUE"};
        const std::string name = lower_case(line.substr(0, colon));
        const std::string_view value = without_blanks(line.substr(colon + 1));
        const auto is_control = [](char c) { return (static_cast<unsigned char>(c) < ' ' && c != '\t') || c == 0x7f; };
        if (std::any_of(value.begin(), value.end(), is_control))
            throw HttpRefusal{400, fmt::format("the header field {} holds a control character", name)};
        const auto [field, is_new] = request.fields.try_emplace(name, value);
        if (is_new) continue;
        if (name == "host") throw HttpRefusal{400, "the header field Host is there twice"};
        field->second.append(", ").append(value);
    }
    const auto host = request.fields.find("host");
    if (host == request.fields.end()) throw HttpRefusal{400, "the header field Host is missing"};
    // RFC 9112, 3.2.2: the host of the address counts. Both must be local here, so the stranger of the two is kept.
    request.host = host_of_address.empty() || !is_local_host(host->second) ? host->second : host_of_address;
    const std::string connection = request.fields["connection"];
    if (lists(connection, "close")) request.keep_alive = false;
    // A body would be taken for the next request, because nothing here reads one.
    const auto length = request.fields.find("content-length");
    if ((length != request.fields.end() && length->second != "0") || request.fields.contains("transfer-encoding"))
        request.keep_alive = false;
    return request;
}

bool is_local_host(std::string_view host) {
    const auto colon = host.find(':', host.starts_with('[') ? std::min(host.find(']'), host.size()) : 0);
    const std::string name = lower_case(host.substr(0, colon));
    if (name != "localhost" && name != "127.0.0.1" && name != "[::1]") return false;
    const std::string_view port = colon == std::string_view::npos ? "" : host.substr(colon + 1);
    return port.size() <= 5 && port.find_first_not_of("0123456789") == std::string_view::npos;
}

RangeKind parse_byte_range(std::string_view value, std::uint64_t size, ByteRange& range) {
    constexpr std::string_view kUnit = "bytes=";
    if (lower_case(value.substr(0, kUnit.size())) != kUnit) return RangeKind::kWhole;
    const std::string_view text = without_blanks(value.substr(kUnit.size()));
    const auto dash = text.find('-');
    if (dash == std::string_view::npos) return RangeKind::kWhole;
    // Reads decimal digits alone; a number beyond 64 bits is the largest one. Empty for anything else.
    const auto number = [](std::string_view digits) -> std::optional<std::uint64_t> {
        if (digits.empty() || digits.find_first_not_of("0123456789") != std::string_view::npos) return std::nullopt;
        std::uint64_t n = 0;
        const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), n);
        return error == std::errc() ? n : UINT64_MAX;
    };
    const std::string_view first_text = text.substr(0, dash), last_text = text.substr(dash + 1);
    const auto first = number(first_text), last = number(last_text);
    if ((!first && !first_text.empty()) || (!last && !last_text.empty()) || (!first && !last)) return RangeKind::kWhole;
    if (!first) {                                              // the last N bytes
        if (size == 0 && *last > 0) return RangeKind::kWhole;  // satisfiable, but no Content-Range says "no bytes"
        range = {size - std::min(*last, size), std::min(*last, size)};
        return range.length > 0 ? RangeKind::kPart : RangeKind::kNotSatisfiable;
    }
    if (last && *last < *first) return RangeKind::kWhole;
    if (*first >= size) return RangeKind::kNotSatisfiable;
    range = {*first, std::min(last.value_or(UINT64_MAX), size - 1) - *first + 1};
    return RangeKind::kPart;
}

}  // namespace gs
