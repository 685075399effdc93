// SPDX-License-Identifier: Apache-2.0
// The one place where the parser and the writer of JSON are instantiated.
#include "lib/core/json_text.h"

#include <fmt/format.h>

#include <set>
#include <vector>

namespace gs {
namespace {

template <class Json> std::string text_of(const Json& json, int indent) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

/// What is valid JSON but not taken. It is caught where the library's own errors are.
struct JsonFault : nlohmann::json::exception {
    explicit JsonFault(const std::string& what) : exception(0, what.c_str()) {}
};

// The library writes and copies values by recursion: a deep one would exhaust the stack. No file nests ten levels.
constexpr int kMaxDepth = 100;

template <class Json, class Input> Json parsed(Input& in, bool comments) {
    std::vector<std::set<std::string>> keys;  // of the objects that are open
    return Json::parse(
        in,
        [&](int depth, typename Json::parse_event_t event, Json& value) {
            using Event = typename Json::parse_event_t;
            if (depth > kMaxDepth) throw JsonFault(fmt::format("it is nested deeper than {} levels", kMaxDepth));
            if (event == Event::object_start) keys.emplace_back();
            if (event == Event::object_end) keys.pop_back();
            if (event == Event::key && !keys.back().insert(value.template get<std::string>()).second)
                throw JsonFault(fmt::format("the key {} stands twice in one object", json_text(value)));
            return true;
        },
        true, comments);
}

template <class Json, class Input> Json parsed_or_discarded(Input& in) {
    try {
        return parsed<Json>(in, false);
    } catch (const nlohmann::json::exception&) {
        return Json(Json::value_t::discarded);
    }
}

}  // namespace

std::string json_text(const nlohmann::json& json, int indent) { return text_of(json, indent); }
std::string json_text(const nlohmann::ordered_json& json, int indent) { return text_of(json, indent); }

nlohmann::json parse_json(const std::string& text) { return parsed<nlohmann::json>(text, false); }
nlohmann::json parse_json(std::istream& in, bool comments) { return parsed<nlohmann::json>(in, comments); }

nlohmann::json try_parse_json(const std::string& text) { return parsed_or_discarded<nlohmann::json>(text); }
nlohmann::json try_parse_json(std::istream& in) { return parsed_or_discarded<nlohmann::json>(in); }
nlohmann::ordered_json try_parse_ordered_json(std::istream& in) {
    return parsed_or_discarded<nlohmann::ordered_json>(in);
}

}  // namespace gs
