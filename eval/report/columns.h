// SPDX-License-Identifier: Apache-2.0
// The numeric columns of tables: metrics by their names in results.json, then the costs of a run.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/report/table.h"

namespace gs {

/// The direction in which a column's values are better.
enum class Better { kNeither, kHigher, kLower };

/// A unit in which all values of a column can be written.
struct ColumnUnit {
    std::string name;
    double factor = 1;  ///< from the values of the column
    int decimals = 0;
};

/// A column: its names, and how its values are read and written.
struct Column {
    std::string key;    ///< name in CSV and JSON; a metric's name in results.json
    std::string title;  ///< heading for readers
    Better better = Better::kNeither;
    std::string (*text)(double) = nullptr;                     ///< value rounded for readers, with its unit
    std::optional<double> (*cost)(const TableRow&) = nullptr;  ///< value of a cost; null for a metric
    std::vector<ColumnUnit> units = {};                        ///< from small to large; empty for pure numbers
};

/// Returns the largest unit of which `largest` has at least two, or the smallest. The column must have units.
const ColumnUnit& column_unit(const Column& column, double largest);

/// Returns PSNR, SSIM, every other metric that a row has or was asked for (those of unknown names last), then the
/// bytes of a Gaussian, #Gs, train time, peak memory and FPS.
std::vector<Column> table_columns(const std::vector<TableRow>& rows);

/// Returns the row's value; empty where it has none.
std::optional<double> column_value(const Column& column, const TableRow& row);

}  // namespace gs
