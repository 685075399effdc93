// SPDX-License-Identifier: Apache-2.0
// Writes tables as text for people and programs.
#pragma once

#include <optional>
#include <string>

#include "eval/pages/text_table.h"
#include "eval/report/comparison.h"

namespace gs {

/// The formats of format_comparison.
enum class TableFormat { kMarkdown, kTerminal, kCsv, kLatex, kJson };

/// Parses markdown | csv | latex | json. Throws UsageError naming these. (kTerminal is Markdown without escapes and
/// marks, for stdout that is a terminal.)
TableFormat parse_table_format(const std::string& name);

/// Writes all tables, ending with a newline. Markdown and LaTeX (booktabs) are rounded for reading. They show mean +-
/// deviation and the worst run where runs were repeated, mark places 1, 2, 3 (bold, underlined, italic) as far as
/// `marks`, and state the protocol under every table. LaTeX has one unit a column, in its heading. CSV (one table, one
/// line a row) and JSON carry full numbers: times in seconds, memory in bytes.
std::string format_comparison(const Comparison& comparison, TableFormat format, std::optional<int> marks = {});

/// Writes all tables as CSV.
std::string comparison_csv(const Comparison& comparison);
/// Writes all tables as JSON.
std::string comparison_json(const Comparison& comparison);

/// Returns the cells that Markdown, LaTeX and HTML show. Leaves out columns of words that say nothing (no options, no
/// correction, one run) and columns of costs that no line has. `marks` places are marked; empty: 3 where more than
/// three lines compare, otherwise 1. With `units_in_header` all numbers of a column have the unit that its heading
/// names.
TextTable text_table(const ComparisonTable& table, const std::vector<Column>& columns, std::optional<int> marks = {},
                     bool units_in_header = false);

}  // namespace gs
