// SPDX-License-Identifier: Apache-2.0
// The list of columns, and the value of each in a row.
#include "eval/report/columns.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "eval/metrics/metrics.h"
#include "lib/core/duration.h"

namespace gs {
namespace {

std::string two_digits(double v) { return fmt::format("{:.2f}", v); }
std::string four_digits(double v) { return fmt::format("{:.4f}", v); }
std::string whole(double v) { return fmt::format("{:.0f}", v); }
std::string one_digit(double v) { return fmt::format("{:.1f}", v); }
std::string percent(double v) { return fmt::format("{:.1f} %", 100 * v); }
std::string gibibytes(double v) { return fmt::format("{:.2f} GiB", v / double(1 << 30)); }

/// Returns the metrics in the order of columns. 3DGS's metrics.py writes "LPIPS" without naming the net.
std::vector<MetricInfo> column_metrics() {
    std::vector<MetricInfo> metrics = known_metrics();
    const auto flip =
        std::find_if(metrics.begin(), metrics.end(), [](const MetricInfo& info) { return info.name == "flip"; });
    metrics.insert(flip, {"lpips", "LPIPS", false, 4});
    return metrics;
}

std::optional<double> as_double(const std::optional<std::int64_t>& n) {
    return n ? std::optional(double(*n)) : std::nullopt;
}

const std::vector<Column>& cost_columns() {
    static const std::vector<Column> columns = {
        {"residual_share",
         "residuals",
         Better::kNeither,
         percent,
         [](const TableRow& r) { return r.residual_share; },
         {{"%", 100, 1}}},
        {"bytes_per_gaussian", "bytes/G", Better::kLower, whole,
         [](const TableRow& r) { return as_double(r.bytes_per_gaussian); }},
        {"ply_bytes_per_gaussian", "PLY B/G", Better::kLower, whole,
         [](const TableRow& r) { return as_double(r.ply_bytes_per_gaussian); }},
        {"web_bytes_per_gaussian", "web B/G", Better::kLower, whole,
         [](const TableRow& r) { return as_double(r.web_bytes_per_gaussian); }},
        {"num_gaussians", "#Gs", Better::kNeither, whole, [](const TableRow& r) { return as_double(r.num_gaussians); }},
        {"train_seconds",
         "train time",
         Better::kLower,
         duration_text,
         [](const TableRow& r) { return r.train_seconds; },
         {{"s", 1, 1}, {"min", 1 / 60.0, 1}, {"h", 1 / 3600.0, 2}}},
        {"peak_device_bytes",
         "peak memory",
         Better::kLower,
         gibibytes,
         [](const TableRow& r) { return as_double(r.peak_device_bytes); },
         {{"GiB", 1 / double(1 << 30), 2}}},
        {"fps", "FPS", Better::kHigher, one_digit, [](const TableRow& r) {
             return r.frame_seconds && *r.frame_seconds > 0 ? std::optional(1 / *r.frame_seconds) : std::nullopt;
         }}};
    return columns;
}

}  // namespace

std::vector<Column> table_columns(const std::vector<TableRow>& rows) {
    std::set<std::string> wanted = {"PSNR", "SSIM"};
    for (const TableRow& row : rows) {
        for (const auto& [name, value] : row.further_metrics) wanted.insert(name);
        for (const auto& [name, reason] : row.not_measured) wanted.insert(name);
    }
    std::vector<Column> columns;
    for (const MetricInfo& m : column_metrics())
        if (wanted.erase(m.key) > 0)
            columns.push_back({m.key, m.key, m.higher_is_better ? Better::kHigher : Better::kLower,
                               m.decimals == 2 ? two_digits : four_digits});
    for (const std::string& name : wanted) columns.push_back({name, name, Better::kNeither, four_digits});
    columns.insert(columns.end(), cost_columns().begin(), cost_columns().end());
    return columns;
}

const ColumnUnit& column_unit(const Column& column, double largest) {
    const ColumnUnit* unit = &column.units.front();
    for (const ColumnUnit& other : column.units)
        if (largest * other.factor >= 2) unit = &other;
    return *unit;
}

std::optional<double> column_value(const Column& column, const TableRow& row) {
    if (column.cost) return column.cost(row);
    if (column.key == "PSNR") return row.psnr;
    if (column.key == "SSIM") return row.ssim;
    const auto found = row.further_metrics.find(column.key);
    return found == row.further_metrics.end() ? std::nullopt : std::optional(found->second);
}

}  // namespace gs
