// SPDX-License-Identifier: Apache-2.0
// A table for readers before it becomes Markdown, LaTeX or HTML.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// The text of a cell, not escaped yet.
struct TextCell {
    std::string text, deviation = {};  ///< no deviation where it is empty
    int place = 0;                     ///< 1, 2, 3 in its column, 0 = none (see ColumnStats)
};

/// A title, a header and lines of cells.
struct TextTable {
    std::string title;  ///< may be empty
    std::vector<std::string> header;
    std::size_t num_labels = 0;  ///< leading columns that hold words; the others are aligned right
    std::vector<std::vector<TextCell>> lines;
    std::size_t first_grey = std::size_t(-1);  ///< lines from this one on are shown grey
};

/// Returns the table in Markdown, ending with a newline. Columns are padded, so that it reads as a table in a terminal,
/// too.
std::string markdown_table(const TextTable& table);

/// Returns the same without escapes and marks of places, for people who read it on a terminal.
std::string terminal_table(const TextTable& table);

}  // namespace gs
