// SPDX-License-Identifier: Apache-2.0
// The experiments of `gsapp bench --suite`: which runs one is made of, which of them are done, and the table over them.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/cell.h"
#include "lib/core/train_options.h"

namespace gs {

/// One run of a suite.
struct SuiteCell {
    std::string row;         ///< what the suite varies: "MCMC 0.1x", "softplus, opacity rate auto"
    std::string appearance;
    TrainOptions options;    ///< validated; `model` is the cell's own folder
};

/// densification: MCMC, MCMC with a tenth of --cap-max, ADC, ADC with Speedy-Splat's pruning.
/// activations: the four colour activations, each with opacity rate 0.05, 0.025 and auto.
std::vector<std::string> suite_names();

/// The runs of a suite, all rows of the first appearance before the second's. `base`: not validated, so that "0 or -1 = by
/// strategy" is decided in every cell by its own; what the suite varies is overwritten, `eval` is on. Folders are
/// <base.model>/<row>-<appearance>. Throws UsageError for an unknown suite, and where validate does.
std::vector<SuiteCell> suite_cells(const std::string& suite, const std::vector<std::string>& appearances, const TrainOptions& base);

struct SuiteLine {
    SuiteCell cell;
    std::optional<CellResult> result;
    std::string error;  ///< why there is no result; empty: the cell was not reached
};

/// A Markdown table, one line a cell.
std::string format_suite(const std::vector<SuiteLine>& lines);

/// Writes suite.md and suite.json to the folder, each atomically. Throws DataError.
void write_suite(const std::filesystem::path& folder, const std::string& suite, const std::vector<SuiteLine>& lines);

}  // namespace gs
