// SPDX-License-Identifier: Apache-2.0
// What a trade-off varies: axes as users write them, and the configurations they span.
#pragma once

#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

struct TradeoffAxis {
    std::string name;  ///< key of an option, "budget": share of --cap-max, or "precision": a name of precision_levels()
    std::vector<std::string> values;  ///< as text
};

/// One value on each axis.
struct Configuration {
    std::vector<std::string> values;
    TrainOptions options;  ///< validated, with `eval`; `model` is its own folder
};

/// Reads "appearance=none,sh", "budget=0.1,1", or names without values ("appearance,budget"), which take their default
/// values: appearance none, nasg, neural, sh; budget 0.1, 0.3, 1; precision full, and fast on a GPU or cutoffs on the
/// CPU; iterations a quarter and all of `base.iterations`; any other option all its choices. time and size are short
/// for time-limit and size-limit. Axes may be any option that changes the model, its time or its size, and leaves
/// scores comparable. Values are not checked yet. Throws UsageError for an unknown name (naming the nearest), a name
/// twice, or without values if there are no default ones.
std::vector<TradeoffAxis> parse_axes(const std::vector<std::string>& words, const TrainOptions& base);

/// Returns `base` with these values (`base` is not validated, so that each configuration decides "0 or -1 = by
/// strategy"), in the folder <base.model>/<axis>-<value>_<axis>-<value>. Throws UsageError for a value that its option
/// refuses.
Configuration make_configuration(const std::vector<TradeoffAxis>& axes, const std::vector<std::string>& values,
                                 const TrainOptions& base);

/// All combinations in the order in which they are to be trained. The cheapest (iterations times --cap-max) comes
/// first, then always the one that differs most from all before it. Those that are trained when time runs out therefore
/// span the whole. Throws UsageError for fewer than two, more than 1000, and equal ones.
std::vector<Configuration> spread_grid(const std::vector<TradeoffAxis>& axes, const TrainOptions& base);

/// Names a configuration, e.g. "appearance sh, budget 0.3, iterations 7500".
std::string configuration_name(const std::vector<TradeoffAxis>& axes, const Configuration& configuration);

}  // namespace gs
