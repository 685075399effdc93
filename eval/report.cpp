// SPDX-License-Identifier: Apache-2.0
// The page: tables as HTML, and everything put into its place.
#include "eval/report.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include "eval/comparison_format.h"
#include "eval/escape.h"
#include "eval/report_page.h"
#include "eval/stability.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

std::string html_of(const TextCell& cell) {
    std::string text = html_escaped(cell.text);
    if (cell.place > 0) text = fmt::format("<span class=\"place{0}\">{1}<sup title=\"place {0}\">{0}</sup></span>", cell.place, text);
    return cell.deviation.empty() ? text : text + " &plusmn; " + html_escaped(cell.deviation);
}

std::string html_of(const TextTable& table) {
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
    return html + "</tbody>\n</table>\n</div>\n";
}

std::string protocol_below(const std::string& protocol) { return fmt::format("<p class=\"protocol\">{}</p>\n", html_escaped(protocol)); }

/// Of all scenes; tables of datasets repeat them.
std::vector<const TableRow*> rows_of(const Comparison& comparison) {
    std::vector<const TableRow*> rows;
    for (const ComparisonTable& table : comparison.tables) {
        if (table.scene.empty() && !table.dataset.empty()) continue;
        for (const ComparisonLine& line : table.lines)
            for (const TableRow& row : line.rows) rows.push_back(&row);
    }
    return rows;
}

/// Replaces the one place where `key` stands.
void fill(std::string& page, const std::string& key, const std::string& text) {
    const std::string mark = "{{" + key + "}}";
    page.replace(page.find(mark), mark.size(), text);
}

}  // namespace

std::string report_tables(const Comparison& comparison) {
    std::string html;
    for (const ComparisonTable& table : comparison.tables) html += html_of(text_table(table, comparison.columns)) + protocol_below(comparison.protocol);
    return html;
}

std::string report_frame_times(const Comparison& comparison) {
    std::vector<FrameTimesLine> lines;
    std::vector<std::string> unmeasured;
    for (const TableRow* row : rows_of(comparison)) {
        if (row->frame_times)
            lines.push_back({row->run, row->scene, row->model, row->num_gaussians, *row->frame_times});
        else
            unmeasured.push_back(row->run);
    }
    std::string html;
    if (!lines.empty()) {
        TextTable table = frame_times_table(lines);
        table.title = "Rendering one view";
        html = html_of(table) + protocol_below(kFrameProtocol);
    }
    if (!unmeasured.empty())
        html += fmt::format("<p class=\"note\">Not measured: {}. <code>gsapp bench --frames RUN</code> measures runs, and the next page shows it.</p>\n",
                            html_escaped(fmt::format("{}", fmt::join(unmeasured, ", "))));
    return html;
}

std::string report_stability(const Comparison& comparison) {
    std::vector<std::string> models;
    for (const TableRow* row : rows_of(comparison)) models.push_back(row->model.substr(0, row->model.find(' ')));  // without the degree
    TextTable table = stability_table(measure_stability(models));
    table.title = "Largest errors of single precision at the extremes of every input";
    return html_of(table);
}

void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options) {
    std::string page = kReportPage;
    // From the end of the page: texts of users may hold marks themselves.
    fill(page, "pictures", report_pictures(comparison, options));
    fill(page, "program", html_escaped(version_text()));
    fill(page, "stability", report_stability(comparison));
    fill(page, "plots", report_plots(comparison));
    fill(page, "frames", report_frame_times(comparison));
    fill(page, "tables", report_tables(comparison));
    write_text_atomic(path, page);
}

}  // namespace gs
