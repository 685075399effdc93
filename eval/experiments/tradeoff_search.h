// SPDX-License-Identifier: Apache-2.0
// Trains the configurations of a trade-off, round by round, within a time limit.
#pragma once

#include <chrono>
#include <optional>

#include "eval/experiments/cell_runner.h"
#include "eval/experiments/tradeoff_plan.h"

namespace gs {

/// Trains the rounds of `plan` and fills `plan.tradeoff.runs`; writes the trade-off to its folder after every run. A
/// round after the first trains the better half of the one before (`promoted`), provided that this one is complete but
/// for failures. With a deadline nothing is started that TimePlan expects to end after it. Throws what write_tradeoff
/// and `run` throw. Call catch_interrupts() before.
CellsSummary search_tradeoff(TradeoffPlan& plan, std::optional<std::chrono::steady_clock::time_point> deadline,
                             const CellsRunner& run = run_cells);

}  // namespace gs
