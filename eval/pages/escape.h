// SPDX-License-Identifier: Apache-2.0
// Escapes user text for each table format.
#pragma once

#include <string>

namespace gs {

/// Replaces line breaks and tabs by spaces.
std::string one_line(const std::string& text);
/// Escapes text for a cell of a Markdown table, on one line.
std::string markdown_escaped(const std::string& text);
/// Returns a field of RFC 4180, in quotes if necessary.
std::string csv_escaped(const std::string& text);
/// Escapes text for LaTeX, on one line.
std::string latex_escaped(const std::string& text);
/// Escapes HTML text and quoted attribute values.
std::string html_escaped(const std::string& text);

}  // namespace gs
