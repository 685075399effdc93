// SPDX-License-Identifier: Apache-2.0
// Trains a suite: its cells, one after another or one on each GPU, with the table written after each.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "eval/experiments/cell_runner.h"
#include "eval/experiments/suite.h"

namespace gs {

/// A suite after its cells were trained.
struct SuiteRun {
    std::filesystem::path folder;  ///< holds suite.md, suite.json and the cells' folders
    std::vector<SuiteLine> lines;
    CellsSummary summary;
};

/// Trains the cells of a suite that its folder `base.model` (empty: output/<scene>-<suite>) does not hold yet, and
/// writes suite.md and suite.json after each. `base` as for suite_lines. A run that fails does not stop the others: the
/// summary tells. Throws UsageError for mistakes in the arguments, before anything is written, and what write_suite and
/// `run` throw. Call catch_interrupts() before.
SuiteRun run_suite(const std::string& suite, const std::vector<std::string>& appearances, TrainOptions base,
                   const CellsRunner& run = run_cells);

}  // namespace gs
