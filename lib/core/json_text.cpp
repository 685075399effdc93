// SPDX-License-Identifier: Apache-2.0
// Instantiates the JSON library's parser and writer.
#include "lib/core/json_text.h"

#include <fmt/format.h>
#include <cmath>

#include <charconv>
#include <iterator>
#include <optional>
#include <set>
#include <string_view>
#include <vector>

#include "lib/core/utf8.h"

namespace gs {
namespace {

// The library accepts and returns only UTF-8. Other bytes pass through it as marks: a NUL, which no file name contains,
// and two hexadecimal digits. In a text with marks, a NUL itself is marked as 00.

std::string with_marks(std::string_view bytes) {
    std::string out;
    for (std::size_t at = 0; at < bytes.size();) {
        const std::size_t length = utf8_length(bytes, at);
        if (length == 0 || bytes[at] == '\0')
            out += '\0' + fmt::format("{:02x}", static_cast<unsigned char>(bytes[at]));
        else
            out += bytes.substr(at, length);
        at += length == 0 ? 1 : length;
    }
    return out;
}

/// Returns the value of the `digits` hexadecimal digits at `at`; nothing if there are fewer.
std::optional<unsigned> hexadecimal(std::string_view text, std::size_t at, std::size_t digits) {
    unsigned value = 0;
    if (at + digits > text.size()) return std::nullopt;
    const auto [end, error] = std::from_chars(text.data() + at, text.data() + at + digits, value, 16);
    return error == std::errc() && end == text.data() + at + digits ? std::optional(value) : std::nullopt;
}

std::string without_marks(std::string_view marked) {
    std::string out;
    for (std::size_t at = 0; at < marked.size(); ++at) {
        const auto byte = marked[at] == '\0' ? hexadecimal(marked, at + 1, 2) : std::nullopt;
        out += byte ? char(*byte) : marked[at];
        if (byte) at += 2;
    }
    return out;
}

/// Applies `change` to all strings and keys.
template <class Json, class Change> Json with_strings(const Json& json, const Change& change) {
    if (json.is_string()) return change(json.template get_ref<const std::string&>());
    if (!json.is_structured()) return json;
    Json out = json.is_array() ? Json::array() : Json::object();
    if (json.is_array())
        for (const Json& element : json) out.push_back(with_strings(element, change));
    else
        for (const auto& [key, value] : json.items()) out[change(key)] = with_strings(value, change);
    return out;
}

constexpr std::size_t kEscape = 6;  // "\u0000"

/// Returns the code unit of an escape \uXXXX at `at`; nothing for another character or escape.
std::optional<unsigned> escaped_unit(std::string_view json, std::size_t at) {
    return json.substr(at, 2) == "\\u" ? hexadecimal(json, at + 2, 4) : std::nullopt;
}

/// Returns the JSON text with marks replaced by the escapes \udcNN.
std::string escapes_of_marks(std::string_view json) {
    std::string out;
    for (std::size_t at = 0; at < json.size();) {
        std::size_t length = json[at] == '\\' ? 2 : 1;
        if (escaped_unit(json, at) == 0u) {
            const std::string_view digits = json.substr(at + kEscape, 2);
            out += digits == "00" ? "\\u0000" : fmt::format("\\udc{}", digits);
            length = kEscape + 2;
        } else {
            out += json.substr(at, length);
        }
        at += length;
    }
    return out;
}

/// Returns the JSON text with unpaired escapes \udcNN replaced by marks; nothing if there are none.
std::optional<std::string> marks_of_escapes(std::string_view json) {
    std::string out;
    bool any = false;
    for (std::size_t at = 0; at < json.size();) {
        const std::optional<unsigned> unit = escaped_unit(json, at);
        std::size_t length = unit ? kEscape : json[at] == '\\' ? 2 : 1;
        const auto is_low = [](unsigned u) { return u >= 0xDC00 && u <= 0xDFFF; };
        if (unit && *unit >= 0xD800 && *unit < 0xDC00 && is_low(escaped_unit(json, at + kEscape).value_or(0)))
            length = 2 * kEscape;
        const bool is_byte = unit && *unit >= 0xDC80 && *unit <= 0xDCFF;
        any = any || is_byte;
        if (is_byte || unit == 0u)
            out += fmt::format("\\u0000{:02x}", *unit & 0xFF);
        else
            out += json.substr(at, length);
        at += length;
    }
    return any ? std::optional(out) : std::nullopt;
}

template <class Json> std::string text_of(const Json& json, int indent) {
    try {
        return json.dump(indent);
    } catch (const nlohmann::json::type_error&) {  // a string is not UTF-8
        return escapes_of_marks(with_strings(json, with_marks).dump(indent));
    }
}

/// The error for valid JSON that is not accepted. It is caught together with the library's own errors.
struct JsonFault : nlohmann::json::exception {
    explicit JsonFault(const std::string& what) : exception(0, what.c_str()) {}
};

// The largest depth of nesting. The library writes and copies values by recursion, so a deeply nested value would
// exhaust the stack. No file nests ten levels.
constexpr int kMaxDepth = 100;

/// Checks a text before it is parsed to a value. Its members are the library's SAX callbacks. (A filter in the parser
/// itself would take quadratic time in the length of a list.)
class Walk {
  public:
    bool start_object(std::size_t) {
        keys_.emplace_back();
        return enter();
    }
    bool end_object() {
        keys_.pop_back();
        --depth_;
        return true;
    }
    bool start_array(std::size_t) { return enter(); }
    bool end_array() {
        --depth_;
        return true;
    }
    bool key(std::string& name) {
        if (keys_.back().insert(name).second) return true;
        return refuse(fmt::format("the key {} stands twice in one object", json_text(nlohmann::json(name))));
    }
    bool null() { return true; }
    bool boolean(bool) { return true; }
    bool number_integer(std::int64_t) { return true; }
    bool number_unsigned(std::uint64_t) { return true; }
    bool number_float(double, const std::string&) { return true; }
    bool string(std::string&) { return true; }
    bool binary(nlohmann::json::binary_t&) { return true; }
    bool parse_error(std::size_t, const std::string&, const nlohmann::json::exception&) { return false; }

    /// Returns the reason to reject a text that is JSON; empty if there is none.
    const std::string& fault() const { return fault_; }

  private:
    bool enter() {
        return ++depth_ <= kMaxDepth || refuse(fmt::format("it is nested deeper than {} levels", kMaxDepth));
    }
    bool refuse(std::string fault) {
        fault_ = std::move(fault);
        return false;
    }

    int depth_ = 0;
    std::vector<std::set<std::string>> keys_;  ///< keys of the open objects
    std::string fault_;
};

template <class Json> Json parsed(const std::string& text, bool comments) {
    if (text.find("\\u") != std::string::npos)
        if (const auto marked = marks_of_escapes(text))
            return with_strings(parsed<Json>(*marked, comments), without_marks);
    Walk walk;
    // Invalid JSON is left to the parser below, which reports the place.
    nlohmann::json::sax_parse(text, &walk, nlohmann::json::input_format_t::json, true, comments);
    if (!walk.fault().empty()) throw JsonFault(walk.fault());
    return Json::parse(text, nullptr, true, comments);
}

template <class Json> Json parsed_or_discarded(const std::string& text) {
    try {
        return parsed<Json>(text, false);
    } catch (const nlohmann::json::exception&) {
        return Json(Json::value_t::discarded);
    }
}

}  // namespace

std::string json_text(const nlohmann::json& json, int indent) { return text_of(json, indent); }
std::string json_text(const nlohmann::ordered_json& json, int indent) { return text_of(json, indent); }

nlohmann::json parse_json(const std::string& text, bool comments) { return parsed<nlohmann::json>(text, comments); }

nlohmann::json try_parse_json(const std::string& text) { return parsed_or_discarded<nlohmann::json>(text); }
nlohmann::ordered_json try_parse_ordered_json(const std::string& text) {
    return parsed_or_discarded<nlohmann::ordered_json>(text);
}

nlohmann::ordered_json finite_or_null(double value) {
    return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

const nlohmann::ordered_json* find_member(const nlohmann::ordered_json* object, const std::string& key) {
    if (!object || !object->is_object()) return nullptr;
    const auto found = object->find(key);
    return found == object->end() ? nullptr : &*found;
}

}  // namespace gs
