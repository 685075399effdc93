// SPDX-License-Identifier: Apache-2.0
// What a trade-off will train, checked before any time is spent.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/tradeoff.h"
#include "eval/experiments/tradeoff_rounds.h"

namespace gs {

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
