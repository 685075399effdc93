// SPDX-License-Identifier: Apache-2.0
// Writes tables as Markdown and LaTeX for readers, and as CSV and JSON for programs.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "eval/report/comparison.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

std::string or_dash(const std::string& text) { return text.empty() ? "-" : text; }

/// Formats a value of a column: with its unit, or in `unit`, which the heading names.
std::string value_text(const Column& column, const ColumnUnit* unit, double value) {
    return unit ? fmt::format("{:.{}f}", value * unit->factor, unit->decimals) : column.text(value);
}

TextCell cell_of(const ComparisonLine& line, const Column& column, const ColumnUnit* unit,
                 const std::optional<ColumnStats>& stats) {
    if (stats) {
        // "+- 0" is informative for a metric; sizes are mostly equal by construction.
        const bool varies = stats->deviation && (!column.cost || *stats->deviation > 0);
        return {value_text(column, unit, stats->mean), varies ? value_text(column, unit, *stats->deviation) : "",
                stats->place};
    }
    if (column.cost) return {"-", "", 0};
    const auto lacks_weights = [&](const RunResult& run) {
        const auto score = run.scores.find(column.key);
        return score != run.scores.end() && score->second.reason.find("no weights") != std::string::npos;
    };
    return {std::any_of(line.runs.begin(), line.runs.end(), lacks_weights) ? "no weights" : "not measured", "", 0};
}

/// Returns a cell with the lowest PSNR and its run.
TextCell worst_cell(const ComparisonLine& line, const Column& psnr, const std::optional<ColumnStats>& stats) {
    if (line.num_runs < 2 || !stats) return {"-", "", 0};
    const std::string value = psnr.text(stats->worst);
    // A dataset's k-th run consists of one run per scene, so the seed identifies it.
    return {line.num_scenes > 1 ? fmt::format("{} (seed {})", value, line.runs[stats->worst_run].seed)
                                : fmt::format("{} ({})", value, line.runs[stats->worst_run].run),
            "", 0};
}

std::string latex_of(const TextCell& cell) {
    static constexpr const char* kBefore[] = {"", "\\textbf{", "\\underline{", "\\textit{"};
    std::string text = kBefore[cell.place] + latex_escaped(cell.text) + (cell.place > 0 ? "}" : "");
    return cell.deviation.empty() ? text : text + " $\\pm$ " + latex_escaped(cell.deviation);
}

std::string latex(const TextTable& table, const std::string& protocol) {
    std::string text =
        fmt::format("% {}\n\\begin{{tabular}}{{{}{}}}\n\\toprule\n", one_line(table.title),
                    std::string(table.num_labels, 'l'), std::string(table.header.size() - table.num_labels, 'r'));
    const auto joined = [](const std::vector<std::string>& cells) {
        std::string line;
        for (std::size_t c = 0; c < cells.size(); ++c) line += (c > 0 ? " & " : "") + cells[c];
        return line + " \\\\\n";
    };
    std::vector<std::string> cells;
    for (const std::string& title : table.header) cells.push_back(latex_escaped(title));
    text += joined(cells) + "\\midrule\n";
    for (const auto& line : table.lines) {
        cells.clear();
        for (const TextCell& cell : line) cells.push_back(latex_of(cell));
        text += joined(cells);
    }
    // The protocol is a separate paragraph, because a cell of that length would widen the table.
    return text + fmt::format("\\bottomrule\n\\end{{tabular}}\n\\par\\smallskip\n{{\\footnotesize {}\\par}}\n",
                              latex_escaped(protocol));
}

using Json = nlohmann::ordered_json;

const char* direction_name(Better better) {
    if (better == Better::kNeither) return "neither";
    return better == Better::kHigher ? "higher" : "lower";
}

Json json_of(const ColumnStats& stats, const ComparisonLine& line) {
    Json json = {{"mean", finite_or_null(stats.mean)}};
    if (stats.deviation) json["deviation"] = *stats.deviation;
    if (line.num_runs > 1) json["worst"] = finite_or_null(stats.worst);
    if (stats.place > 0) json["place"] = stats.place;
    return json;
}

Json json_of(const ComparisonLine& line, const std::vector<Column>& columns) {
    Json json = {{"model", line.model},           {"strategy", line.strategy}, {"options", line.options},
                 {"ppisp_eval", line.correction}, {"num_runs", line.num_runs}, {"num_scenes", line.num_scenes},
                 {"runs", Json::array()},         {"values", Json::object()}};
    for (const RunResult& run : line.runs)
        json["runs"].push_back(
            {{"run", run.run}, {"scene", run.scene}, {"seed", run.seed}, {"iteration", run.iteration}});
    for (std::size_t c = 0; c < columns.size(); ++c)
        json["values"][columns[c].key] = line.values[c] ? json_of(*line.values[c], line) : Json(nullptr);
    return json;
}

std::string joined(const std::vector<std::string>& cells) {
    std::string line;
    for (std::size_t c = 0; c < cells.size(); ++c) line += (c > 0 ? "," : "") + csv_escaped(cells[c]);
    return line + "\n";
}

}  // namespace

TableFormat parse_table_format(const std::string& name) {
    if (name == "markdown") return TableFormat::kMarkdown;
    if (name == "csv") return TableFormat::kCsv;
    if (name == "latex") return TableFormat::kLatex;
    if (name == "json") return TableFormat::kJson;
    throw UsageError(fmt::format("--format: '{}' is not one of markdown, csv, latex, json", name));
}

TextTable text_table(const ComparisonTable& table, const std::vector<Column>& columns, std::optional<int> marks,
                     bool units_in_header) {
    const int most_places = marks ? *marks : table.lines.size() > 3 ? 3 : 1;
    const auto any = [&](auto says) { return std::any_of(table.lines.begin(), table.lines.end(), says); };
    const bool options = any([](const ComparisonLine& l) { return !l.options.empty(); });
    const bool correction = any([](const ComparisonLine& l) { return !l.correction.empty() && l.correction != "off"; });
    const bool repeated = any([](const ComparisonLine& l) { return l.num_runs > 1; });
    TextTable out;
    if (table.scene.empty() && table.dataset.empty())
        out.title = "scene not stated";
    else if (table.scene.empty())
        out.title = fmt::format("{}: mean of {} scenes", table.dataset, table.num_scenes);
    else
        out.title = table.dataset.empty() ? table.scene : fmt::format("{} ({})", table.scene, table.dataset);
    out.header = {"run", "model", "strategy"};
    if (options) out.header.push_back("options");
    if (correction) out.header.push_back("ppisp");
    if (repeated) out.header.push_back("worst run, PSNR");
    out.num_labels = out.header.size();
    std::vector<std::size_t> shown;
    std::vector<const ColumnUnit*> units;
    for (std::size_t c = 0; c < columns.size(); ++c) {
        if (columns[c].cost && !any([&](const ComparisonLine& l) { return l.values[c].has_value(); })) continue;
        shown.push_back(c);
        units.push_back(nullptr);
        if (units_in_header && !columns[c].units.empty()) {
            double largest = 0;
            for (const ComparisonLine& line : table.lines)
                if (line.values[c]) largest = std::max(largest, line.values[c]->mean);
            units.back() = &column_unit(columns[c], largest);
        }
        out.header.push_back(columns[c].title + (units.back() ? fmt::format(" ({})", units.back()->name) : ""));
    }
    for (const ComparisonLine& line : table.lines) {
        std::vector<TextCell> cells = {
            {or_dash(line.label), "", 0}, {or_dash(line.model), "", 0}, {or_dash(line.strategy), "", 0}};
        if (options) cells.push_back({or_dash(line.options), "", 0});
        if (correction) cells.push_back({or_dash(line.correction), "", 0});
        if (repeated) cells.push_back(worst_cell(line, columns[0], line.values[0]));
        for (std::size_t k = 0; k < shown.size(); ++k) {
            cells.push_back(cell_of(line, columns[shown[k]], units[k], line.values[shown[k]]));
            if (cells.back().place > most_places) cells.back().place = 0;
        }
        out.lines.push_back(std::move(cells));
    }
    return out;
}

std::string format_comparison(const Comparison& comparison, TableFormat format, std::optional<int> marks) {
    if (format == TableFormat::kCsv) return comparison_csv(comparison);
    if (format == TableFormat::kJson) return comparison_json(comparison);
    std::string text;
    for (const ComparisonTable& table : comparison.tables) {
        if (!text.empty()) text += "\n";
        const TextTable cells = text_table(table, comparison.columns, marks, format == TableFormat::kLatex);
        if (format == TableFormat::kLatex)
            text += latex(cells, comparison.protocol);
        else
            text += (format == TableFormat::kTerminal ? terminal_table(cells) : markdown_table(cells)) + "\n" +
                    comparison.protocol + "\n";
    }
    return text;
}

std::string comparison_json(const Comparison& comparison) {
    Json json = {{"protocol", comparison.protocol}, {"columns", Json::array()}, {"tables", Json::array()}};
    for (const Column& column : comparison.columns)
        json["columns"].push_back(
            {{"key", column.key}, {"title", column.title}, {"better", direction_name(column.better)}});
    for (const ComparisonTable& table : comparison.tables) {
        Json lines = Json::array();
        for (const ComparisonLine& line : table.lines) lines.push_back(json_of(line, comparison.columns));
        json["tables"].push_back({{"dataset", table.dataset},
                                  {"scene", table.scene.empty() ? Json(nullptr) : Json(table.scene)},
                                  {"lines", lines}});
    }
    // JSON must be UTF-8, but file names need not be.
    return json_text(json, 1) + "\n";
}

std::string comparison_csv(const Comparison& comparison) {
    std::vector<std::string> cells = {"run",     "dataset", "scene", "model", "strategy",
                                      "options", "ppisp",   "runs",  "scenes"};
    for (const Column& column : comparison.columns) {
        cells.push_back(column.key);
        cells.push_back(column.key + "_deviation");
        cells.push_back(column.key + "_worst");
    }
    cells.push_back("protocol");
    std::string text = joined(cells);
    for (const ComparisonTable& table : comparison.tables) {
        for (const ComparisonLine& line : table.lines) {
            cells = {line.label,
                     table.dataset,
                     table.scene,
                     line.model,
                     line.strategy,
                     line.options,
                     line.correction,
                     std::to_string(line.num_runs),
                     std::to_string(line.num_scenes)};
            for (const auto& stats : line.values) {
                cells.push_back(stats ? fmt::format("{}", stats->mean) : "");
                cells.push_back(stats && stats->deviation ? fmt::format("{}", *stats->deviation) : "");
                cells.push_back(stats && line.num_runs > 1 ? fmt::format("{}", stats->worst) : "");
            }
            cells.push_back(comparison.protocol);
            text += joined(cells);
        }
    }
    return text;
}

}  // namespace gs
