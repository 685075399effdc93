// SPDX-License-Identifier: Apache-2.0
// The numeric columns of tables: metrics by the names in results.json, then what a run cost.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/report/table.h"

namespace gs {

enum class Better { kNeither, kHigher, kLower };

struct Column {
    std::string key;    ///< in CSV and JSON; of a metric its name in results.json
    std::string title;  ///< for readers
    Better better = Better::kNeither;
    std::string (*text)(double) = nullptr;  ///< rounded for readers, with its unit
    std::optional<double> (*cost)(const TableRow&) = nullptr;  ///< where it is no metric
};

/// PSNR, SSIM, every other metric that a row has or was asked for (those of unknown names last), then bytes/G, #Gs, train time, peak memory
/// and FPS.
std::vector<Column> table_columns(const std::vector<TableRow>& rows);

/// The row's value; empty where it has none.
std::optional<double> column_value(const Column& column, const TableRow& row);

}  // namespace gs
