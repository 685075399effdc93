// SPDX-License-Identifier: Apache-2.0
// The page: tables as HTML, and everything put into its place.
#include "eval/report.h"

#include <spdlog/fmt/fmt.h>

#include "eval/comparison_format.h"
#include "eval/escape.h"
#include "eval/report_page.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

std::string html_of(const TextCell& cell) {
    std::string text = html_escaped(cell.text);
    if (cell.place > 0) text = fmt::format("<span class=\"place{0}\">{1}<sup title=\"place {0}\">{0}</sup></span>", cell.place, text);
    return cell.deviation.empty() ? text : text + " &plusmn; " + html_escaped(cell.deviation);
}

std::string html_of(const TextTable& table, const std::string& protocol) {
    std::string html = fmt::format("<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\">\n<table>\n<caption>{0}</caption>\n<thead><tr>",
                                   html_escaped(table.title));
    for (std::size_t c = 0; c < table.header.size(); ++c)
        html += fmt::format("<th scope=\"col\"{}>{}</th>", c < table.num_labels ? "" : " class=\"number\"", html_escaped(table.header[c]));
    html += "</tr></thead>\n<tbody>\n";
    for (const auto& line : table.lines) {
        html += "<tr>";
        for (std::size_t c = 0; c < line.size(); ++c) {
            if (c == 0)
                html += fmt::format("<th scope=\"row\">{}</th>", html_of(line[c]));
            else
                html += fmt::format("<td{}>{}</td>", c < table.num_labels ? "" : " class=\"number\"", html_of(line[c]));
        }
        html += "</tr>\n";
    }
    return html + fmt::format("</tbody>\n</table>\n</div>\n<p class=\"protocol\">{}</p>\n", html_escaped(protocol));
}

/// Replaces the one place where `key` stands.
void fill(std::string& page, const std::string& key, const std::string& text) {
    const std::string mark = "{{" + key + "}}";
    page.replace(page.find(mark), mark.size(), text);
}

}  // namespace

std::string report_tables(const Comparison& comparison) {
    std::string html;
    for (const ComparisonTable& table : comparison.tables) html += html_of(text_table(table, comparison.columns), comparison.protocol);
    return html;
}

void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options) {
    std::string page = kReportPage;
    // From the end of the page: texts of users may hold marks themselves.
    fill(page, "pictures", report_pictures(comparison, options));
    fill(page, "program", html_escaped(version_text()));
    fill(page, "plots", report_plots(comparison));
    fill(page, "tables", report_tables(comparison));
    write_text_atomic(path, page);
}

}  // namespace gs
