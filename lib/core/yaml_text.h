// SPDX-License-Identifier: Apache-2.0
// Parses YAML texts of one document.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>

namespace gs {

/// Parses one YAML document. Throws YAML::ParserException if the text is not YAML, or continues after the document.
/// yaml-cpp itself ignores the rest of a text from a line indented less than the first.
YAML::Node parse_yaml(const std::string& text);

}  // namespace gs
