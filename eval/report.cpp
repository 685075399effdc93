// SPDX-License-Identifier: Apache-2.0
// The page: everything put into its place.
#include "eval/report.h"

#include "eval/comparison_format.h"
#include "eval/escape.h"
#include "eval/html_page.h"
#include "eval/report_page.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {

std::string report_tables(const Comparison& comparison) {
    std::string html;
    for (const ComparisonTable& table : comparison.tables) html += html_table(text_table(table, comparison.columns), comparison.protocol);
    return html;
}

void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options) {
    std::string page = page_head("gsapp: comparison of runs") + kReportPage;
    // From the end of the page: texts of users may hold marks themselves.
    fill(page, "pictures", report_pictures(comparison, options));
    fill(page, "program", html_escaped(version_text()));
    fill(page, "plots", report_plots(comparison));
    fill(page, "tables", report_tables(comparison));
    write_text_atomic(path, page);
}

}  // namespace gs
