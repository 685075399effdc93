// SPDX-License-Identifier: Apache-2.0
// What a trade-off will train, and in how many rounds, checked before any time is spent.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/tradeoff.h"
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

enum class SearchKind {
    kGrid,     ///< every combination (plan_grid)
    kHalving,  ///< all for a short time, the better half for longer (plan_halving)
};

/// What the user asks of a trade-off.
struct TradeoffRequest {
    std::vector<std::string> axes;  ///< as for parse_axes; empty: the default ones of the search
    SearchKind search = SearchKind::kGrid;
    Quality quality = Quality::kPsnr;
    std::optional<double> give_up = {};  ///< as Tradeoff::give_up; empty: 1 dB, or 0.02 of SSIM
};

struct TradeoffPlan {
    std::filesystem::path folder;
    Tradeoff tradeoff;  ///< without runs yet
    Rounds rounds;
};

/// Plans a trade-off in the folder `base.model` (empty: output/<scene>-tradeoff); `base` as for make_configuration.
/// Loads the scene: budgets below its number of points are remarked, because training keeps these points. Throws
/// UsageError for mistakes in the request, for `base.resume`, and for a folder that holds a run of other options
/// (unless `base.overwrite`); DataError for a scene without test views.
TradeoffPlan plan_tradeoff(TrainOptions base, const TradeoffRequest& request);

}  // namespace gs
