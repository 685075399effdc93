// SPDX-License-Identifier: Apache-2.0
// Escapes text that users chose for each format of a table.
#pragma once

#include <string>

namespace gs {

/// Replaces line breaks and tabs by spaces.
std::string one_line(const std::string& text);
/// Escapes the text of a cell of a Markdown table, on one line.
std::string markdown_escaped(const std::string& text);
/// Returns a field of RFC 4180 and puts it in quotes where it must be.
std::string csv_escaped(const std::string& text);
/// Escapes the text for LaTeX, on one line.
std::string latex_escaped(const std::string& text);
/// Escapes HTML text and attribute values in quotes.
std::string html_escaped(const std::string& text);

}  // namespace gs
