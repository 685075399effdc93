// SPDX-License-Identifier: Apache-2.0
// Writes a trade-off as Markdown, JSON and an HTML page.
#include "eval/experiments/tradeoff_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "eval/pages/html_page.h"
#include "eval/pages/scatter.h"
#include "lib/core/json_text.h"
#include "lib/core/quantities.h"
#include "lib/core/version.h"
#include "lib/io/atomic_file.h"
#include "lib/scene/scene.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

const char* state_name(RunState state) {
    switch (state) {
        case RunState::kFinished:
            return "finished";
        case RunState::kFailed:
            return "failed";
        case RunState::kStopped:
            return "stopped at the time limit";
        case RunState::kNoTime:
            return "not started: would not have ended in time";
        case RunState::kNotReached:
            break;
    }
    return "not reached";
}

/// Returns the names of the recommendations that refer to this run.
std::string titles(const std::vector<Recommendation>& recommendations, std::size_t run) {
    std::string text;
    for (const Recommendation& r : recommendations)
        if (r.run == run) text += (text.empty() ? "" : ", ") + r.name;
    return text;
}

Json json_of(const Tradeoff& tradeoff, const TradeoffRun& run, bool in_frontier) {
    Json json = {{"run", run.configuration.options.model}, {"status", state_name(run.state)}};
    for (std::size_t a = 0; a < tradeoff.axes.size(); ++a)
        json["values"][tradeoff.axes[a].name] = run.configuration.values[a];
    if (!run.error.empty()) json["error"] = run.error;
    if (!run.result) return json;
    json["pareto_optimal"] = in_frontier;
    json.update(job_json(*run.result));
    return json;
}

/// A cost for the plots: its field and its unit.
struct Cost {
    const char *field, *title, *axis;
    double unit;  ///< factor from the field's value to the plotted value
};
constexpr Cost kCosts[] = {{"train_seconds", "training time", "training time, s", 1},
                           {"frame_seconds", "frame time", "time of a frame, ms", 1e3},
                           {"bytes", "size", "size of the scene, MB", 1e-6},
                           {"peak_device_bytes", "peak memory of the training", "peak memory, GiB", 1.0 / (1 << 30)}};

/// Returns the index of the run's value on the first axis: runs with the same value share a colour.
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
        const double x = cost.unit * field_number(*run.result, result_field(cost.field)).value_or(0),
                     y = quality_of(*run.result, tradeoff.quality);
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

std::string quality_text(double value, Quality quality) {
    return quality == Quality::kPsnr ? fmt::format("{:.2f} dB", value) : fmt::format("SSIM {:.4f}", value);
}

std::string loss_text(double difference, Quality quality) {
    return quality == Quality::kPsnr ? fmt::format("{:.2f} dB", difference) : fmt::format("{:.4f} SSIM", difference);
}

std::string bytes_text(std::int64_t bytes) {
    return fmt::format("{:.{}f} MB", 1e-6 * double(bytes), bytes < 10'000'000 ? 2 : bytes < 100'000'000 ? 1 : 0);
}

std::string fps_text(const RunResult& result) { return result.fps() ? fmt::format("{:.1f}", *result.fps()) : "-"; }

TextTable tradeoff_table(const Tradeoff& tradeoff) {
    const Ranking ranking = rank_runs(tradeoff);
    const std::vector<Recommendation> recommendations = recommend(tradeoff);
    const bool memory = std::any_of(tradeoff.runs.begin(), tradeoff.runs.end(),
                                    [](const TradeoffRun& run) { return run.result && run.result->peak_device_bytes; });
    TextTable table;
    table.title = fmt::format("Trade-off of {}", scene_name(tradeoff.source));
    for (const TradeoffAxis& axis : tradeoff.axes) table.header.push_back(axis.name);
    table.header.push_back("Pareto");
    table.num_labels = table.header.size();
    for (const char* title : {"PSNR", "SSIM", "#Gs", "train time", "FPS", "size"}) table.header.push_back(title);
    if (memory) table.header.push_back("peak memory");
    table.first_grey = ranking.frontier.size();
    std::vector<std::size_t> order = ranking.frontier;
    order.insert(order.end(), ranking.dominated.begin(), ranking.dominated.end());
    for (std::size_t i = 0; i < order.size(); ++i) {
        const TradeoffRun& run = tradeoff.runs[order[i]];
        const RunResult& r = *run.result;
        std::vector<TextCell> line;
        const auto add = [&](const std::string& text) { line.push_back({text, "", 0}); };
        for (const std::string& value : run.configuration.values) add(value);
        const std::string title = titles(recommendations, order[i]);
        add(i >= table.first_grey ? "dominated" : title.empty() ? "optimal" : "optimal: " + title);
        add(fmt::format("{:.2f}", r.psnr));
        add(fmt::format("{:.4f}", r.ssim));
        add(std::to_string(*r.num_gaussians));
        add(duration_text(*r.train_seconds));
        add(fps_text(r));
        add(bytes_text(*r.bytes));
        if (memory)
            add(r.peak_device_bytes ? fmt::format("{:.2f} GiB", double(*r.peak_device_bytes) / double(1 << 30)) : "-");
        table.lines.push_back(std::move(line));
    }
    return table;
}

std::vector<std::string> tradeoff_notes(const Tradeoff& tradeoff) {
    std::vector<std::string> notes = tradeoff.remarks;
    const auto finished = std::find_if(tradeoff.runs.begin(), tradeoff.runs.end(),
                                       [](const TradeoffRun& run) { return run.result.has_value(); });
    if (finished == tradeoff.runs.end()) return notes;
    notes.push_back(
        fmt::format("Optimal: no other configuration is at least as good in {}, training time, FPS and size, and "
                    "better in one of them.",
                    quality_name(tradeoff.quality)));
    notes.push_back(
        fmt::format("One run each (seed {}): small differences may be chance, and times depend on what else the "
                    "machine did. Size: of the PLY.",
                    finished->configuration.options.seed));
    notes.push_back(finished->result->protocol_line());
    return notes;
}

std::string state_text(const TradeoffRun& run) {
    return run.error.empty() ? state_name(run.state)
                             : fmt::format("{}: {}", state_name(run.state), one_line(run.error));
}

std::string format_tradeoff(const Tradeoff& tradeoff, TableStyle style) {
    std::string text;
    const TextTable table = tradeoff_table(tradeoff);
    if (table.lines.empty())
        text += title_text(table.title, style) + "No configuration was trained to its end.\n";
    else
        text += table_text(table, style) + "\n";
    for (const Recommendation& r : recommend(tradeoff))
        text += fmt::format("- {}: {}\n", emphasized(r.name, style), r.text);
    bool first = true;
    for (const TradeoffRun& run : tradeoff.runs) {
        if (run.result) continue;
        if (first) text += "\nWithout a result:\n\n";
        first = false;
        text += fmt::format("- {}: {}\n", configuration_name(tradeoff.axes, run.configuration), state_text(run));
    }
    text += "\n";
    for (const std::string& note : tradeoff_notes(tradeoff)) text += note + "\n";
    return text;
}

std::string tradeoff_json(const Tradeoff& tradeoff) {
    Json json = {{"source", tradeoff.source},
                 {"program", version_text()},
                 {"quality", quality_name(tradeoff.quality)},
                 {"give_up", tradeoff.give_up}};
    json["axes"] = Json::array();
    for (const TradeoffAxis& axis : tradeoff.axes)
        json["axes"].push_back({{"name", axis.name}, {"values", axis.values}});
    const std::vector<std::size_t> front = rank_runs(tradeoff).frontier;
    json["runs"] = Json::array();
    for (std::size_t k = 0; k < tradeoff.runs.size(); ++k)
        json["runs"].push_back(
            json_of(tradeoff, tradeoff.runs[k], std::find(front.begin(), front.end(), k) != front.end()));
    json["remarks"] = tradeoff.remarks;
    json["recommendations"] = Json::object();
    for (const Recommendation& r : recommend(tradeoff))
        json["recommendations"][r.name] = {{"run", tradeoff.runs[r.run].configuration.options.model}, {"text", r.text}};
    return json_text(json, 1) + "\n";
}

void write_tradeoff(const std::filesystem::path& folder, const Tradeoff& tradeoff) {
    write_text_atomic(folder / "tradeoff.json", tradeoff_json(tradeoff));
    write_text_atomic(folder / "tradeoff.md", format_tradeoff(tradeoff));
    write_text_atomic(folder / "tradeoff.html", tradeoff_page(tradeoff));
}

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
