// SPDX-License-Identifier: Apache-2.0
// Compares runs: repeated ones share a line, each scene has a table, and so has each dataset of several scenes. The
// columns are metrics by their names in results.json, then the costs of a run.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "eval/runs/run_result.h"

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
    std::string key;    ///< name in CSV and JSON: of the metric or the field, or fps of frame_seconds
    std::string title;  ///< heading for readers
    Better better = Better::kNeither;
    std::string (*text)(double) = nullptr;  ///< value rounded for readers, with its unit
    const ResultField* cost = nullptr;      ///< the field that is shown; null for a metric
    std::vector<ColumnUnit> units = {};     ///< from small to large; empty for pure numbers
};

/// Returns the largest unit of which `largest` has at least two, or the smallest. The column must have units.
const ColumnUnit& column_unit(const Column& column, double largest);

/// Returns PSNR, SSIM, every other metric that a result has or was asked for (those of unknown names last), then the
/// bytes of a Gaussian, #Gs, train time, peak memory and FPS.
std::vector<Column> table_columns(const std::vector<RunResult>& runs);

/// Returns the value of a result; empty if it has none.
std::optional<double> column_value(const Column& column, const RunResult& result);

/// The statistics of one column over the runs of a line.
struct ColumnStats {
    double mean = 0;
    std::optional<double> deviation;  ///< sample deviation (n - 1); empty for one run and for infinite values
    double worst = 0;                 ///< worst value; the mean in a column without direction
    std::size_t worst_run = 0;        ///< number of the worst run, from 0
    int place = 0;                    ///< 1, 2, 3 in its table; 0 = none. Values that read the same share a place
};

/// Runs that differ only by their seed.
struct ComparisonLine {
    std::vector<RunResult> runs;  ///< ordered by seed; for a dataset the runs of all its scenes
    std::string label;            ///< name of the run, or first and last name and number of runs
    std::string model, strategy, correction;
    std::string options;  ///< "key value, ...": differences between lines of one model and strategy
    std::size_t num_runs = 1;
    std::size_t num_scenes = 1;
    std::vector<std::optional<ColumnStats>> values;  ///< one per column; empty if a run lacks it
};

/// The lines of one scene or dataset.
struct ComparisonTable {
    std::string dataset, scene;  ///< an empty scene stands for the mean over the dataset's scenes
    std::size_t num_scenes = 1;  ///< number of the dataset's scenes; lines with fewer get no places
    std::vector<ComparisonLine> lines;
};

/// The tables of all scenes and datasets.
struct Comparison {
    std::string protocol;  ///< protocol_line of all runs, or a note that none is stated
    std::vector<Column> columns;
    std::vector<ComparisonTable> tables;  ///< tables of scenes in the order of the runs, then of datasets
};

/// Returns mean, deviation and worst of at least one value.
ColumnStats column_stats(const std::vector<double>& values, Better better);

/// Groups runs of equal scene, iteration, correction and training options. A run without options gets a line of its
/// own. A line of a dataset takes the mean over the scenes run by run (runs are paired by seed), then the mean over
/// runs. Where the seeds of the scenes differ it is the mean of the scenes' means, without deviation. Throws UsageError
/// when protocols differ or a folder is named twice.
Comparison compare_runs(const std::vector<RunResult>& runs);

/// The formats of format_comparison.
enum class TableFormat { kMarkdown, kTerminal, kCsv, kLatex, kJson };

/// Parses markdown | csv | latex | json. Throws UsageError naming these. (kTerminal is Markdown without escapes and
/// marks, for stdout that is a terminal.)
TableFormat parse_table_format(const std::string& name);

/// Writes all tables, ending with a newline. Markdown and LaTeX (booktabs) are rounded for reading. They show mean +-
/// deviation and the worst run where runs were repeated, mark places 1, 2, 3 (bold, underlined, italic) as far as
/// `marks`, and state the protocol under every table. LaTeX has one unit a column, in its heading. CSV (one table, one
/// line a row) and JSON carry full numbers: times in seconds, memory in bytes.
std::string format_comparison(const Comparison& comparison, TableFormat format, std::optional<int> marks = {});

/// Writes all tables as CSV.
std::string comparison_csv(const Comparison& comparison);
/// Writes all tables as JSON.
std::string comparison_json(const Comparison& comparison);

/// Returns the cells that Markdown, LaTeX and HTML show. Leaves out columns of words that say nothing (no options, no
/// correction, one run) and columns of costs that no line has. `marks` places are marked; empty: 3 where more than
/// three lines compare, otherwise 1. With `units_in_header` all numbers of a column have the unit that its heading
/// names.
TextTable text_table(const ComparisonTable& table, const std::vector<Column>& columns, std::optional<int> marks = {},
                     bool units_in_header = false);

}  // namespace gs
