// SPDX-License-Identifier: Apache-2.0
// The page of a trade-off: recommendations, plots, table.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "eval/experiments/tradeoff_text.h"
#include "eval/pages/escape.h"
#include "eval/pages/html_page.h"
#include "eval/pages/scatter.h"
#include "lib/core/version.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

struct Cost {
    const char *title, *axis;
    double (*value)(const CellResult&);  ///< 0: not measured
};
constexpr Cost kCosts[] = {
    {"training time", "training time, s", [](const CellResult& r) { return r.train_seconds; }},
    {"frame time", "time of a frame, ms", [](const CellResult& r) { return 1e3 * r.frame_seconds; }},
    {"size", "size of the scene, MB", [](const CellResult& r) { return 1e-6 * double(r.bytes); }},
    {"peak memory of the training", "peak memory, GiB",
     [](const CellResult& r) { return double(r.peak_device_bytes.value_or(0)) / double(1 << 30); }}};

/// Where the value of the first axis stands among its values: runs that share it share a colour.
int series_of(const Tradeoff& tradeoff, const TradeoffRun& run) {
    const auto& values = tradeoff.axes.front().values;
    return int(std::find(values.begin(), values.end(), run.configuration.values.front()) - values.begin());
}

std::string plot(const Tradeoff& tradeoff, const Ranking& ranking, const std::vector<Recommendation>& recommendations,
                 const Cost& cost) {
    ScatterPlot plot;
    plot.title = fmt::format("{} over {}", quality_name(tradeoff.quality), cost.title);
    plot.x_title = cost.axis;
    plot.y_title = tradeoff.quality == Quality::kPsnr ? "PSNR, dB" : "SSIM";
    plot.log_x = plot.connect_front = true;
    const auto add = [&](std::size_t k, bool optimal) {
        const TradeoffRun& run = tradeoff.runs[k];
        const double x = cost.value(*run.result), y = quality_of(*run.result, tradeoff.quality);
        if (!(x > 0) || !std::isfinite(y)) return;
        plot.points.push_back(
            {.x = x,
             .y = y,
             .label = fmt::format("{}", fmt::join(run.configuration.values, " ")),
             .tooltip = fmt::format("{}: {:.4g}, {}", configuration_name(tradeoff.axes, run.configuration), x,
                                    quality_text(y, tradeoff.quality)),
             .series = series_of(tradeoff, run),
             .ring = std::any_of(recommendations.begin(), recommendations.end(),
                                 [&](const Recommendation& r) { return r.run == k; }),
             .grey = !optimal});
    };
    for (const std::size_t k : ranking.frontier) add(k, true);
    for (const std::size_t k : ranking.dominated) add(k, false);
    return plot.points.empty() ? "" : scatter_svg(plot);
}

std::string section(const std::string& id, const std::string& title, const std::string& content) {
    return fmt::format("<section aria-labelledby=\"{0}\">\n<h2 id=\"{0}\">{1}</h2>\n{2}</section>\n", id, title,
                       content);
}

std::string note(const std::string& text) { return fmt::format("<p class=\"note\">{}</p>\n", html_escaped(text)); }

}  // namespace

std::string tradeoff_page(const Tradeoff& tradeoff) {
    const Ranking ranking = rank_runs(tradeoff);
    const std::string title = fmt::format("Trade-off of {}", scene_name(tradeoff.source));
    std::string body = fmt::format("<body>\n<h1>{}</h1>\n<main>\n", html_escaped(title));
    if (ranking.frontier.empty()) {
        body += note("No configuration was trained to its end.");
        for (const std::string& line : tradeoff.remarks) body += note(line);
    } else {
        std::string words, plots, names;
        const std::vector<Recommendation> recommendations = recommend(tradeoff);
        for (const Recommendation& r : recommendations)
            words += fmt::format("<li><strong>{}</strong>: {}</li>\n", r.name, html_escaped(r.text));
        for (const Cost& cost : kCosts) plots += plot(tradeoff, ranking, recommendations, cost);
        for (const TradeoffAxis& axis : tradeoff.axes) names += (names.empty() ? "" : ", ") + axis.name;
        body += section("h-words", "Which to take", "<ul>\n" + words + "</ul>\n");
        body += section("h-plots", "Quality against cost",
                        note(fmt::format("Optimal configurations in colour, by {}, the recommended ones with a ring; "
                                         "dominated ones in grey. The dashed line joins what "
                                         "is best in its plot alone. Labels are {}; pointing at any configuration "
                                         "tells more. Up and left is better.",
                                         tradeoff.axes.front().name, names)) +
                            "<div class=\"plots\">\n" + plots + "</div>\n");
        std::string notes;
        for (const std::string& line : tradeoff_notes(tradeoff)) notes += note(line);
        body += section("h-table", "All runs", html_table(tradeoff_table(tradeoff), "") + notes);
    }
    std::string missing;
    for (const TradeoffRun& run : tradeoff.runs)
        if (!run.result)
            missing += fmt::format("<li>{}</li>\n", html_escaped(configuration_name(tradeoff.axes, run.configuration) +
                                                                 ": " + state_text(run)));
    if (!missing.empty()) body += section("h-missing", "Without a result", "<ul>\n" + missing + "</ul>\n");
    return page_head("gsapp: " + title) + body +
           fmt::format("</main>\n<footer>{}</footer>\n</body>\n</html>\n", html_escaped(version_text()));
}

}  // namespace gs
