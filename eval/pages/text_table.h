// SPDX-License-Identifier: Apache-2.0
// A table for readers, before it is Markdown, LaTeX or HTML.
#pragma once

#include <string>
#include <vector>

namespace gs {

/// Text that is not escaped yet.
struct TextCell {
    std::string text, deviation = {};  ///< deviation empty: none
    int place = 0;                     ///< as in ColumnStats
};

struct TextTable {
    std::string title;  ///< may be empty
    std::vector<std::string> header;
    std::size_t num_labels = 0;  ///< leading columns that hold words; the others are aligned right
    std::vector<std::vector<TextCell>> lines;
    std::size_t first_grey = std::size_t(-1);  ///< lines from this one on matter less
};

/// Columns padded to one width, so that the text reads as a table in a terminal, too. Ends with a newline.
std::string markdown_table(const TextTable& table);

}  // namespace gs
