// SPDX-License-Identifier: Apache-2.0
// Runs side by side: repeated ones put together, one table a scene, one a dataset of several scenes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/report/columns.h"

namespace gs {

/// One column over the runs of a line.
struct ColumnStats {
    double mean = 0;
    std::optional<double> deviation;  ///< of the sample (n - 1); empty for one run, and where values are infinite
    double worst = 0;                 ///< by the column's direction; the mean where it has none
    std::size_t worst_run = 0;
    int place = 0;  ///< 1, 2, 3 in its table; 0 = not among them. Values that read the same share a place
};

/// Runs that differ only by their seed.
struct ComparisonLine {
    std::vector<TableRow> rows;  ///< in the order of their seeds; of a dataset all rows that went into it
    std::string label;           ///< of one run its name, else first and last name and how many
    std::string model, strategy, correction;
    std::string options;  ///< "key value, ...": what tells apart runs of one scene, model and strategy
    std::size_t num_runs = 1;
    std::size_t num_scenes = 1;
    std::vector<std::optional<ColumnStats>> values;  ///< one per column; empty where a run does not have it
};

struct ComparisonTable {
    std::string dataset, scene;  ///< scene empty: means over the scenes of the dataset
    std::size_t num_scenes = 1;  ///< of the dataset; lines with fewer get no places
    std::vector<ComparisonLine> lines;
};

struct Comparison {
    std::string protocol;  ///< protocol_line of all rows, or that none is stated
    std::vector<Column> columns;
    std::vector<ComparisonTable> tables;  ///< scenes in the order of the rows, then datasets
};

/// mean, deviation and worst of at least one value.
ColumnStats column_stats(const std::vector<double>& values, Better better);

/// Groups rows of equal scene, iteration, correction and training options; those without options stand for themselves. A line of a
/// dataset is the mean over its scenes run by run (runs paired by seed), then the mean over runs; where the seeds of the scenes differ, the mean of the
/// scenes' means, without deviation. Throws UsageError when protocols differ, or a folder is named twice.
Comparison compare_runs(const std::vector<TableRow>& rows);

}  // namespace gs
