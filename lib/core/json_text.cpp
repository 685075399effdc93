// SPDX-License-Identifier: Apache-2.0
// The one place where the parser and the writer of JSON are instantiated.
#include "lib/core/json_text.h"

namespace gs {
namespace {

template <class Json> std::string text_of(const Json& json, int indent) {
    return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string json_text(const nlohmann::json& json, int indent) { return text_of(json, indent); }
std::string json_text(const nlohmann::ordered_json& json, int indent) { return text_of(json, indent); }

nlohmann::json parse_json(const std::string& text) { return nlohmann::json::parse(text); }
nlohmann::json parse_json(std::istream& in) { return nlohmann::json::parse(in); }

nlohmann::json try_parse_json(const std::string& text) { return nlohmann::json::parse(text, nullptr, false); }
nlohmann::json try_parse_json(std::istream& in) { return nlohmann::json::parse(in, nullptr, false); }
nlohmann::ordered_json try_parse_ordered_json(std::istream& in) {
    return nlohmann::ordered_json::parse(in, nullptr, false);
}

}  // namespace gs
