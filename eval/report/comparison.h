// SPDX-License-Identifier: Apache-2.0
// Compares runs: repeated runs share a line, each scene has a table, and so does each dataset of several scenes. The
// columns are metrics, under their names in results.json, then the costs of a run.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "eval/runs/run_result.h"

namespace gs {

/// The direction in which a column's values are better.
enum class Better { kNeither, kHigher, kLower };

/// A unit for all values of a column.
struct ColumnUnit {
    std::string name;
    double factor = 1;  ///< factor from column values to this unit
    int decimals = 0;
};

/// A column: its names, and how its values are read and formatted.
struct Column {
    std::string key;    ///< name in CSV and JSON: the key of the metric or the field, or "fps" for frame_seconds
    std::string title;  ///< heading for readers
    Better better = Better::kNeither;
    std::string (*text)(double) = nullptr;  ///< formats a value with its unit, rounded for readers
    const ResultField* cost = nullptr;      ///< displayed field; null for a metric
    std::vector<ColumnUnit> units = {};     ///< from small to large; empty for pure numbers
};

/// Returns the largest unit in which `largest` is at least two, else the smallest unit. The column must have units.
const ColumnUnit& column_unit(const Column& column, double largest);

/// Returns PSNR, SSIM, every other metric that a result contains or was evaluated with (unknown names last), then bytes
/// per Gaussian, #Gs, train time, peak memory and FPS.
std::vector<Column> table_columns(const std::vector<RunResult>& runs);

/// Returns the column's value of a result; empty if the result lacks it.
std::optional<double> column_value(const Column& column, const RunResult& result);

/// The statistics of one column over the runs of a line.
struct ColumnStats {
    double mean = 0;
    std::optional<double> deviation;  ///< sample standard deviation (n - 1); empty for one run and for infinite values
    double worst = 0;                 ///< worst value; the mean in a column without direction
    std::size_t worst_run = 0;        ///< number of the worst run, from 0
    int place = 0;                    ///< 1, 2, 3 in its table; 0 = none. Values equal after rounding share it
};

/// Runs that differ only by their seed.
struct ComparisonLine {
    std::vector<RunResult> runs;  ///< ordered by seed; for a dataset the runs of all its scenes
    std::string label;            ///< name of the run; for several, first and last name and their number
    std::string model, strategy, correction;
    std::string options;  ///< differences in options between lines of one model and strategy: "key value, ..."
    std::size_t num_runs = 1;
    std::size_t num_scenes = 1;
    std::vector<std::optional<ColumnStats>> values;  ///< statistics per column; empty if a run lacks a value
};

/// The lines of one scene or dataset.
struct ComparisonTable {
    std::string dataset, scene;  ///< names; an empty scene stands for the mean over the dataset's scenes
    std::size_t num_scenes = 1;  ///< number of the dataset's scenes; lines with fewer get no places
    std::vector<ComparisonLine> lines;
};

/// The tables of all scenes and datasets.
struct Comparison {
    std::string protocol;  ///< protocol_line of all runs, or a note that none is given
    std::vector<Column> columns;
    std::vector<ComparisonTable> tables;  ///< tables of scenes in the order of the runs, then of datasets
};

/// Returns mean, deviation and worst of at least one value.
ColumnStats column_stats(const std::vector<double>& values, Better better);

/// Groups runs with equal scene, iteration, correction and training options. A run without options gets its own line. A
/// dataset line averages over the scenes for each run (runs are paired by seed), then over the runs. If the seeds of
/// the scenes differ, it is the mean of the scenes' means, without deviation. Throws UsageError if protocols differ or
/// a folder is given twice.
Comparison compare_runs(const std::vector<RunResult>& runs);

/// Output formats of format_comparison.
enum class TableFormat { kMarkdown, kTerminal, kCsv, kLatex, kJson };

/// Parses markdown | csv | latex | json. Throws UsageError listing these. (kTerminal is Markdown without escapes and
/// marks, for output to a terminal.)
TableFormat parse_table_format(const std::string& name);

/// Returns all tables as text, ending with a newline. Markdown and LaTeX (booktabs) are rounded for reading. They show
/// mean +- deviation and the worst run if runs were repeated, mark the first `marks` places (bold, underlined, italic
/// for 1, 2, 3), and state the protocol below every table. LaTeX has one unit per column, in its heading. CSV (one
/// table, one line per row) and JSON contain full precision: times in seconds, memory in bytes.
std::string format_comparison(const Comparison& comparison, TableFormat format, std::optional<int> marks = {});

/// Returns all tables as CSV.
std::string comparison_csv(const Comparison& comparison);
/// Returns all tables as JSON.
std::string comparison_json(const Comparison& comparison);

/// Returns the cells of the Markdown, LaTeX and HTML tables. Omits text columns without information (no options, no
/// correction, one run) and cost columns without values. `marks`: number of marked places; empty: 3 if more than three
/// lines are compared, otherwise 1. With `units_in_header` all numbers of a column are in the unit of its heading.
TextTable text_table(const ComparisonTable& table, const std::vector<Column>& columns, std::optional<int> marks = {},
                     bool units_in_header = false);

}  // namespace gs
