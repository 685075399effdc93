// SPDX-License-Identifier: Apache-2.0
// JSON to text and back. The library's parser and writer are templates; they are compiled here once.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace gs {

/// Returns the text of `json`: on one line, or with `indent` spaces a level. A byte 0xNN of a name that is not UTF-8
/// becomes the escape \udcNN, as Python writes it (surrogateescape). The functions below make it that byte again.
std::string json_text(const nlohmann::json& json, int indent = -1);
std::string json_text(const nlohmann::ordered_json& json, int indent = -1);

/// Parses one JSON value, with comments (// and /* */) if these are allowed. Throws nlohmann::json::exception for what
/// is not JSON, is nested too deep, or names a key twice in one object.
nlohmann::json parse_json(const std::string& text, bool comments = false);

/// Parses one JSON value without comments; the result is_discarded() if the text is none, or
/// such a one as `parse_json` does not take.
nlohmann::json try_parse_json(const std::string& text);
/// The same, and the keys keep their order.
nlohmann::ordered_json try_parse_ordered_json(const std::string& text);

}  // namespace gs
