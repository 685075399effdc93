// SPDX-License-Identifier: Apache-2.0
// Checks UTF-8 by table 3-7 of the Unicode standard, composes with utf8proc and converts with iconv.
#include "lib/core/utf8.h"

#include <iconv.h>
#include <utf8proc.h>

#include <cctype>
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <optional>
#include <utility>

namespace gs {
namespace {

/// Applies utf8proc_map to `text`. Returns nothing for a text that is not UTF-8.
std::optional<std::string> mapped(std::string_view text, int options) {
    utf8proc_uint8_t* out = nullptr;
    const utf8proc_ssize_t size =
        utf8proc_map(reinterpret_cast<const utf8proc_uint8_t*>(text.data()), utf8proc_ssize_t(text.size()), &out,
                     utf8proc_option_t(options | UTF8PROC_STABLE | UTF8PROC_COMPOSE));
    const std::unique_ptr<utf8proc_uint8_t, decltype(&std::free)> owner(out, &std::free);
    if (size < 0) return {};
    return std::string(reinterpret_cast<const char*>(out), std::size_t(size));
}

/// Converts `bytes` from `encoding` to UTF-8. Returns nothing if they are invalid in it, or the system does not support
/// it.
std::optional<std::string> converted(std::string_view bytes, const char* encoding) {
    const iconv_t handle = ::iconv_open("UTF-8", encoding);
    if (handle == iconv_t(-1)) return {};
    std::string in(bytes), out(4 * bytes.size() + 16, '\0');
    char *from = in.data(), *to = out.data();
    std::size_t left = in.size(), room = out.size();
    const std::size_t result = ::iconv(handle, &from, &left, &to, &room);
    ::iconv_close(handle);
    if (result == std::size_t(-1) || left > 0) return {};
    out.resize(out.size() - room);
    return out;
}

}  // namespace

std::string composed(std::string_view text) { return mapped(text, 0).value_or(std::string(text)); }

std::string case_folded(std::string_view text) {
    if (std::optional<std::string> folded = mapped(text, UTF8PROC_CASEFOLD)) return std::move(*folded);
    std::string out(text);
    for (char& c : out)
        if (static_cast<unsigned char>(c) < 0x80) c = char(std::tolower(c));
    return out;
}

std::vector<Reading> readings(std::string_view bytes) {
    std::vector<Reading> found;
    if (is_utf8(bytes)) return found;
    for (const char* encoding : {"GB18030", "BIG5", "CP932", "CP949", "CP1252", "CP1251", "CP437"})
        if (std::optional<std::string> text = converted(bytes, encoding)) found.push_back({encoding, std::move(*text)});
    return found;
}

std::size_t utf8_length(std::string_view text, std::size_t at) {
    const unsigned char lead = static_cast<unsigned char>(text[at]);
    if (lead < 0x80) return 1;
    if (lead < 0xC2 || lead > 0xF4) return 0;
    const std::size_t length = lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;
    if (at + length > text.size()) return 0;
    // Narrower bounds of the second byte exclude overlong forms, surrogates and code points above U+10FFFF.
    unsigned char low = lead == 0xE0 ? 0xA0 : lead == 0xF0 ? 0x90 : 0x80;
    unsigned char high = lead == 0xED ? 0x9F : lead == 0xF4 ? 0x8F : 0xBF;
    for (std::size_t k = 1; k < length; ++k) {
        const unsigned char c = static_cast<unsigned char>(text[at + k]);
        if (c < low || c > high) return 0;
        low = 0x80, high = 0xBF;
    }
    return length;
}

bool is_utf8(std::string_view text) {
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t length = utf8_length(text, at);
        if (length == 0) return false;
        at += length;
    }
    return true;
}

std::string printable(std::string_view text) {
    std::string out;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t length = utf8_length(text, at);
        out += length == 0 ? std::string_view("\xEF\xBF\xBD") : text.substr(at, length);
        at += length == 0 ? 1 : length;
    }
    return out;
}

}  // namespace gs
