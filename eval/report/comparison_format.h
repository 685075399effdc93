// SPDX-License-Identifier: Apache-2.0
// Tables as text for people and programs.
#pragma once

#include <string>

#include "eval/pages/text_table.h"
#include "eval/report/comparison.h"

namespace gs {

enum class TableFormat { kMarkdown, kCsv, kLatex, kJson };

/// markdown | csv | latex | json. Throws UsageError naming these.
TableFormat parse_table_format(const std::string& name);

/// All tables; ends with a newline. Markdown and LaTeX (booktabs) are rounded for reading, have mean +- deviation and the worst run where
/// runs were repeated, mark places 1, 2, 3 (bold, underlined, italic), and the protocol in one line under every table. CSV (one table, one
/// line a row) and JSON carry full numbers: times in seconds, memory in bytes.
std::string format_comparison(const Comparison& comparison, TableFormat format);

// format_comparison's two forms for programs.
std::string comparison_csv(const Comparison& comparison);
std::string comparison_json(const Comparison& comparison);

/// What a table shows; shared by Markdown, LaTeX and HTML. Columns of words that say nothing (no options, no correction, one run) and of
/// costs that no line has are left out.
TextTable text_table(const ComparisonTable& table, const std::vector<Column>& columns);

}  // namespace gs
