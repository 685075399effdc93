// SPDX-License-Identifier: Apache-2.0
// Trains many runs as processes of this program, one after another or one on each GPU, and keeps those that are finished.
#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/cell.h"
#include "kernels/core/error.h"

namespace gs {

/// A run to train. All cells of one call go to the same device.
struct Cell {
    std::string name;      ///< for messages
    TrainOptions options;  ///< validated; `model` is its own folder
};

/// How one cell ended: with a result, or an error, or (with neither) stopped by the user or the deadline.
struct CellOutcome {
    std::optional<CellResult> result;
    std::string error;
    ExitCode code = ExitCode::kOk;
    std::optional<double> wall_seconds;  ///< of the process; empty: nothing was trained
};

/// Calls that never overlap.
struct CellHooks {
    /// A cell has ended, or was finished before (these come first). An exception stops everything and leaves run_cells.
    std::function<void(std::size_t cell, const CellOutcome&)> done;
    /// Which of the pending cells, given in their order, is trained next; empty = none of them now. Without it, the first.
    std::function<std::optional<std::size_t>(const std::vector<std::size_t>& pending)> choose = {};
    /// When runs under way are stopped and no others started.
    std::optional<std::chrono::steady_clock::time_point> deadline = {};
};

/// What the runs came to.
struct CellsSummary {
    int num_failed = 0;
    ExitCode first_code = ExitCode::kOk;  ///< of the first failure
    bool interrupted = false;             ///< before all were trained
};

/// Trains the cells whose folders do not hold them yet (with `overwrite` all). A run that fails does not stop the others; once
/// interrupted() nothing more is started, and runs under way write their checkpoint and end. Cells that were not reached are not `done`.
/// Call catch_interrupts() before.
CellsSummary run_cells(const std::vector<Cell>& cells, const CellHooks& hooks);

/// Throws Interrupted where the user stopped the runs, else Error with the exit code of the first failure if there was one. `file` has the messages.
void throw_unless_complete(const CellsSummary& summary, std::size_t num_cells, const std::filesystem::path& file);

}  // namespace gs
