// SPDX-License-Identifier: Apache-2.0
// Puts every part of the page into its place.
#include "eval/report/report.h"

#include <fmt/format.h>

#include "eval/bench/stability.h"
#include "eval/pages/escape.h"
#include "eval/pages/html_page.h"
#include "eval/report/comparison_format.h"
#include "eval/report/report_page.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

/// Returns the rows of all scenes. The tables of datasets repeat them and are skipped.
std::vector<const TableRow*> rows_of(const Comparison& comparison) {
    std::vector<const TableRow*> rows;
    for (const ComparisonTable& table : comparison.tables) {
        if (table.scene.empty() && !table.dataset.empty()) continue;
        for (const ComparisonLine& line : table.lines)
            for (const TableRow& row : line.rows) rows.push_back(&row);
    }
    return rows;
}

}  // namespace

std::string report_tables(const Comparison& comparison) {
    std::string html;
    for (const ComparisonTable& table : comparison.tables)
        html += html_table(text_table(table, comparison.columns), comparison.protocol);
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
        html = html_table(table, kFrameProtocol);
    }
    if (!unmeasured.empty())
        html += fmt::format(
            "<p class=\"note\">Not measured: {}. <code>gsapp bench frames RUN</code> measures runs, and the next page "
            "shows it.</p>\n",
            html_escaped(fmt::format("{}", fmt::join(unmeasured, ", "))));
    return html;
}

std::string report_stability(const Comparison& comparison) {
    std::vector<std::string> models;
    for (const TableRow* row : rows_of(comparison))
        models.push_back(row->model.substr(0, row->model.find(' ')));  // no degree
    TextTable table = stability_table(measure_stability(models));
    table.title = "Largest errors of single precision at the extremes of every input";
    return html_table(table, "");
}

void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options) {
    std::string page = page_head("gsapp: comparison of runs") + kReportPage;
    // Fills in from the end of the page, because texts of users may hold placeholders themselves.
    fill(page, "pictures", report_pictures(comparison, options));
    fill(page, "program", html_escaped(version_text()));
    fill(page, "stability", report_stability(comparison));
    fill(page, "plots", report_plots(comparison));
    fill(page, "frames", report_frame_times(comparison));
    fill(page, "tables", report_tables(comparison));
    write_text_atomic(path, page);
}

}  // namespace gs
