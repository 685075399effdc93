// SPDX-License-Identifier: Apache-2.0
// Plans the configurations and rounds of a trade-off, and checks them before any training starts.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/tradeoff.h"
#include "eval/experiments/tradeoff_axes.h"

namespace gs {

/// Configurations by round. Configurations with the same index differ between rounds only in their iterations. A round
/// trains the configurations that were `promoted` from the previous round.
using Rounds = std::vector<std::vector<Configuration>>;

/// Plans one round: every combination of the axes in `words` (empty: appearance, budget, iterations). Fills `axes`.
/// Throws UsageError as parse_axes and spread_grid do.
Rounds plan_grid(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes);

/// Plans three rounds, at a quarter, a half and all of `base.iterations`, which become the last of the `axes` (empty
/// `words`: appearance, budget). Throws UsageError as plan_grid does, for iterations as an axis, and for fewer than 4
/// iterations.
Rounds plan_halving(std::vector<std::string> words, const TrainOptions& base, std::vector<TradeoffAxis>& axes);

enum class SearchKind {
    kGrid,     ///< every combination (plan_grid)
    kHalving,  ///< all configurations for a short time, the better half for longer (plan_halving)
};

/// The user's settings for a trade-off.
struct TradeoffRequest {
    std::vector<std::string> axes;  ///< axes as for parse_axes; empty: the default axes of the search
    SearchKind search = SearchKind::kGrid;
    Quality quality = Quality::kPsnr;
    std::optional<double> give_up = {};  ///< Tradeoff::give_up; empty: 1 dB, or 0.02 of SSIM
};

struct TradeoffPlan {
    std::filesystem::path folder;
    Tradeoff tradeoff;  ///< trade-off without runs yet
    Rounds rounds;
};

/// Plans a trade-off in the folder `base.model` (empty: output/<scene>-tradeoff); `base` as for make_configuration.
/// Loads the scene, and adds a remark if budgets are below its number of points, because training keeps these points.
/// Throws UsageError for invalid requests, for `base.resume`, and for a folder that holds a run of other options
/// (unless `base.overwrite`); DataError for a scene without test views.
TradeoffPlan plan_tradeoff(TrainOptions base, const TradeoffRequest& request);

}  // namespace gs
