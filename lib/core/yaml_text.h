// SPDX-License-Identifier: Apache-2.0
// Reads YAML texts of one document.
#pragma once

#include <yaml-cpp/yaml.h>

#include <string>

namespace gs {

/// Parses one YAML document. Throws YAML::ParserException for what is no YAML, and if the text goes on behind the
/// document. yaml-cpp alone ignores the rest of a text whose lines are indented less than the first one.
YAML::Node parse_yaml(const std::string& text);

}  // namespace gs
