// SPDX-License-Identifier: Apache-2.0
// A table for readers before its conversion to Markdown, LaTeX or HTML.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// The text of a cell, not escaped yet.
struct TextCell {
    std::string text, deviation = {};  ///< deviation empty = none
    int place = 0;                     ///< 1, 2, 3 in its column, 0 = none (see ColumnStats)
};

/// A title, a header and lines of cells.
struct TextTable {
    std::string title;  ///< title; may be empty
    std::vector<std::string> header;
    std::size_t num_labels = 0;  ///< number of leading text columns; the others are right-aligned
    std::vector<std::vector<TextCell>> lines = {};
    std::size_t first_grey = std::size_t(-1);  ///< lines from this index on are shown in grey
};

/// Output style of a table: Markdown for files and pages, or plain text for a terminal.
enum class TableStyle { kMarkdown, kTerminal };

/// Returns the table as text, ending with a newline. Columns are padded, so that the Markdown source is readable, too.
/// The terminal style has no escapes, no title markup and no marks of places.
std::string table_text(const TextTable& table, TableStyle style);
std::string markdown_table(const TextTable& table);
std::string terminal_table(const TextTable& table);

/// Returns a title on its own line, followed by an empty line.
std::string title_text(const std::string& title, TableStyle style);

/// Returns a word with emphasis: bold in Markdown, unchanged for a terminal.
std::string emphasized(const std::string& word, TableStyle style);

}  // namespace gs
