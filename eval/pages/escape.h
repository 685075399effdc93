// SPDX-License-Identifier: Apache-2.0
// Names as users chose them, made harmless in each format of a table.
#pragma once

#include <string>

namespace gs {

/// Line breaks and tabs become spaces.
std::string one_line(const std::string& text);
/// For a cell of a Markdown table.
std::string markdown_escaped(const std::string& text);
/// A field of RFC 4180: in quotes where it must be.
std::string csv_escaped(const std::string& text);
std::string latex_escaped(const std::string& text);
/// For text and for attribute values in double quotes.
std::string html_escaped(const std::string& text);

}  // namespace gs
