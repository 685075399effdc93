// SPDX-License-Identifier: Apache-2.0
// Conversion of JSON to text and back. The JSON library's parser and writer are templates; they are compiled only once,
// here.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace gs {

/// Returns the text of `json` on one line, or with `indent` spaces per level. A byte 0xNN that is not UTF-8, e.g. in a
/// file name, becomes the escape \udcNN, as in Python (surrogateescape). The functions below restore the byte.
std::string json_text(const nlohmann::json& json, int indent = -1);
std::string json_text(const nlohmann::ordered_json& json, int indent = -1);

/// Returns the number, or null for infinity and NaN, which JSON does not have.
nlohmann::ordered_json finite_or_null(double value);

/// Returns object[key]; null if `object` is null or no JSON object, or has no such key.
const nlohmann::ordered_json* find_member(const nlohmann::ordered_json* object, const std::string& key);

/// Parses one JSON value. `comments` allows comments (// and /* */). Throws nlohmann::json::exception if the text is
/// not JSON, is nested too deeply, or repeats a key within one object.
nlohmann::json parse_json(const std::string& text, bool comments = false);

/// Parses one JSON value without comments. For a text that `parse_json` rejects, the result is_discarded().
nlohmann::json try_parse_json(const std::string& text);
/// The same with the keys in their original order.
nlohmann::ordered_json try_parse_ordered_json(const std::string& text);

}  // namespace gs
