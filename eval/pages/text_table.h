// SPDX-License-Identifier: Apache-2.0
// A table for readers before it becomes Markdown, LaTeX or HTML.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// The text of a cell, not escaped yet.
struct TextCell {
    std::string text, deviation = {};  ///< no deviation if it is empty
    int place = 0;                     ///< 1, 2, 3 in its column, 0 = none (see ColumnStats)
};

/// A title, a header and lines of cells.
struct TextTable {
    std::string title;  ///< may be empty
    std::vector<std::string> header;
    std::size_t num_labels = 0;  ///< leading columns that hold words; the others are aligned right
    std::vector<std::vector<TextCell>> lines = {};
    std::size_t first_grey = std::size_t(-1);  ///< lines from this one on are shown grey
};

/// For whom a table is written: Markdown for files and pages, or text as it is for people at a terminal.
enum class TableStyle { kMarkdown, kTerminal };

/// Returns the table, ending with a newline. Columns are padded, so that Markdown reads as a table, too. For a terminal
/// there are no escapes, no mark of the title and no marks of places.
std::string table_text(const TextTable& table, TableStyle style);
std::string markdown_table(const TextTable& table);
std::string terminal_table(const TextTable& table);

/// Returns a title on a line of its own with an empty line below it.
std::string title_text(const std::string& title, TableStyle style);

/// Returns a word with emphasis: bold in Markdown, as it is for a terminal.
std::string emphasized(const std::string& word, TableStyle style);

}  // namespace gs
