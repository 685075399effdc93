// SPDX-License-Identifier: Apache-2.0
// Which configurations a search trains, and in how many rounds.
#pragma once

#include <string>
#include <vector>

#include "eval/experiments/tradeoff_axes.h"

namespace gs {

/// Configurations by round. Those of one index are the same in all rounds but for their iterations; a round trains
/// those that the one before was good enough for (`promoted`).
using Rounds = std::vector<std::vector<Configuration>>;

/// One round: every combination of the axes in `words` (empty: appearance, budget, iterations). Fills `axes`. Throws
/// UsageError as parse_axes and spread_grid do.
Rounds plan_grid(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes);

/// Three rounds, at a quarter, a half and all of `base.iterations`, which become the last of the `axes` (empty `words`:
/// appearance, budget). Throws UsageError as plan_grid does, for iterations as an axis, and for less than 4 iterations.
Rounds plan_halving(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes);

}  // namespace gs
