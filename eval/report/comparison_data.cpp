// SPDX-License-Identifier: Apache-2.0
// Writes tables for programs: CSV and JSON.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "eval/report/comparison_format.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

using Json = nlohmann::ordered_json;

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

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
    for (const TableRow& row : line.rows)
        json["runs"].push_back(
            {{"run", row.run}, {"scene", row.scene}, {"seed", row.seed}, {"iteration", row.iteration}});
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
    // JSON must be UTF-8, which names of files need not be.
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
