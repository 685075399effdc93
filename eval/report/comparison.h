// SPDX-License-Identifier: Apache-2.0
// Compares runs: repeated ones share a line, each scene has a table, and so has each dataset of several scenes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/report/columns.h"

namespace gs {

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
    std::vector<TableRow> rows;  ///< ordered by seed; for a dataset the rows of all its scenes
    std::string label;           ///< name of the run, or first and last name and number of runs
    std::string model, strategy, correction;
    std::string options;  ///< "key value, ...": differences between lines of one model and strategy
    std::size_t num_runs = 1;
    std::size_t num_scenes = 1;
    std::vector<std::optional<ColumnStats>> values;  ///< one per column; empty where a run lacks it
};

/// The lines of one scene or dataset.
struct ComparisonTable {
    std::string dataset, scene;  ///< an empty scene stands for the mean over the dataset's scenes
    std::size_t num_scenes = 1;  ///< number of the dataset's scenes; lines with fewer get no places
    std::vector<ComparisonLine> lines;
};

/// The tables of all scenes and datasets.
struct Comparison {
    std::string protocol;  ///< protocol_line of all rows, or a note that none is stated
    std::vector<Column> columns;
    std::vector<ComparisonTable> tables;  ///< tables of scenes in the order of the rows, then of datasets
};

/// Returns mean, deviation and worst of at least one value.
ColumnStats column_stats(const std::vector<double>& values, Better better);

/// Groups rows of equal scene, iteration, correction and training options. A row without options gets a line of its
/// own. A line of a dataset takes the mean over the scenes run by run (runs are paired by seed), then the mean over
/// runs. Where the seeds of the scenes differ it is the mean of the scenes' means, without deviation. Throws UsageError
/// when protocols differ or a folder is named twice.
Comparison compare_runs(const std::vector<TableRow>& rows);

}  // namespace gs
