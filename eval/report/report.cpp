// SPDX-License-Identifier: Apache-2.0
// Assembles the page, and chooses and fills its plots.
#include "eval/report/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "eval/bench/stability.h"
#include "eval/pages/escape.h"
#include "eval/pages/html_page.h"
#include "eval/pages/scatter.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"

namespace gs {
namespace {

struct Cost {
    const char *key, *title, *axis;
};
constexpr Cost kCosts[] = {{"train_seconds", "training time", "training time, s"},
                           {"bytes_per_gaussian", "appearance size", "appearance, bytes a Gaussian"}};

}  // namespace

std::vector<const RunResult*> runs_of(const Comparison& comparison) {
    std::vector<const RunResult*> runs;
    for (const ComparisonTable& table : comparison.tables) {
        if (table.scene.empty() && !table.dataset.empty()) continue;
        for (const ComparisonLine& line : table.lines)
            for (const RunResult& run : line.runs) runs.push_back(&run);
    }
    return runs;
}

std::string report_tables(const Comparison& comparison) {
    std::string html;
    for (const ComparisonTable& table : comparison.tables)
        html += html_table(text_table(table, comparison.columns), comparison.protocol);
    return html;
}

std::string report_frame_times(const Comparison& comparison) {
    std::vector<FrameTimesLine> lines;
    std::vector<std::string> unmeasured;
    for (const RunResult* run : runs_of(comparison)) {
        if (run->frame_times)
            lines.push_back({run->run, run->scene, run->model, run->num_gaussians, *run->frame_times});
        else
            unmeasured.push_back(run->run);
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
    for (const RunResult* run : runs_of(comparison))
        models.push_back(run->model.substr(0, run->model.find(' ')));  // without the degree
    TextTable table = stability_table(measure_stability(models));
    table.title = "Largest errors of single precision at the extremes of every input";
    return html_table(table, "");
}

void write_report(const std::filesystem::path& path, const Comparison& comparison, const ReportOptions& options) {
    std::string page = page_head("gsapp: comparison of runs") + kReportPage;
    // Fills from the end of the page, because user text may itself contain placeholders.
    fill(page, "pictures", report_pictures(comparison, options));
    fill(page, "program", html_escaped(version_text()));
    fill(page, "stability", report_stability(comparison));
    fill(page, "cameras", report_cameras(comparison, options));
    fill(page, "plots", report_plots(comparison));
    fill(page, "frames", report_frame_times(comparison));
    fill(page, "tables", report_tables(comparison));
    write_text_atomic(path, page);
}

std::string report_plots(const Comparison& comparison) {
    std::string out;
    for (const ComparisonTable& table : comparison.tables) {
        for (const Cost& cost : kCosts) {
            const auto column = std::find_if(comparison.columns.begin(), comparison.columns.end(),
                                             [&](const Column& c) { return c.key == cost.key; });
            const std::size_t k = std::size_t(column - comparison.columns.begin());
            ScatterPlot plot;
            for (const ComparisonLine& line : table.lines) {
                const auto &psnr = line.values[0], &x = line.values[k];
                if (!psnr || !x || !std::isfinite(psnr->mean) || line.num_scenes != table.num_scenes) continue;
                const std::string name = line.model.empty() ? line.label : line.model;
                const std::string label = line.options.empty() ? name : name + ", " + line.options;
                plot.points.push_back({.x = x->mean,
                                       .y = psnr->mean,
                                       .deviation = psnr->deviation.value_or(0),
                                       .label = label,
                                       .tooltip = fmt::format("{}: {:.6g}, {:.2f} dB", label, x->mean, psnr->mean),
                                       .series = int(plot.points.size())});
            }
            if (plot.points.empty()) continue;
            plot.title = fmt::format("{}: PSNR over {}", table.scene.empty() ? table.dataset : table.scene, cost.title);
            plot.x_title = cost.axis, plot.y_title = "PSNR, dB";
            out += scatter_svg(plot);
        }
    }
    return out;
}

}  // namespace gs
