// SPDX-License-Identifier: Apache-2.0
// The axes of a trade-off, parsed from the command line, and the configurations they span.
#pragma once

#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

struct TradeoffAxis {
    /// Key of an option, "budget" (share of --cap-max), or "precision" (a name of precision_levels()).
    std::string name;
    std::vector<std::string> values;  ///< values as text
};

/// One value per axis.
struct Configuration {
    std::vector<std::string> values;
    TrainOptions options;  ///< validated options, with `eval`; `model` is the configuration's own folder
};

/// Parses "appearance=none,sh", "budget=0.1,1", or names without values ("appearance,budget"), which get their default
/// values: appearance none, nasg, neural, sh; budget 0.1, 0.3, 1; precision full, and fast on a GPU or cutoffs on the
/// CPU; iterations a quarter and all of `base.iterations`; any other option all its choices. "time" and "size"
/// abbreviate time-limit and size-limit. An axis may be any option that changes the model, its time or its size and
/// keeps scores comparable. Values are not checked yet. Throws UsageError for an unknown name (suggesting the nearest),
/// a repeated name, or a name without values that has no default ones.
std::vector<TradeoffAxis> parse_axes(const std::vector<std::string>& words, const TrainOptions& base);

/// Returns `base` with these values, in the folder <base.model>/<axis>-<value>_<axis>-<value>. `base` must not be
/// validated yet, so that each configuration resolves "0 or -1 = by strategy" itself. Throws UsageError for a value
/// that its option rejects.
Configuration make_configuration(const std::vector<TradeoffAxis>& axes, const std::vector<std::string>& values,
                                 const TrainOptions& base);

/// Returns all combinations in training order. The cheapest (by iterations times --cap-max) comes first, then always
/// the one that differs most from all before it. The configurations trained before time runs out therefore span the
/// whole grid. Throws UsageError for fewer than two or more than 1000 combinations, and for equal ones.
std::vector<Configuration> spread_grid(const std::vector<TradeoffAxis>& axes, const TrainOptions& base);

/// Returns the name of a configuration, e.g. "appearance sh, budget 0.3, iterations 7500".
std::string configuration_name(const std::vector<TradeoffAxis>& axes, const Configuration& configuration);

}  // namespace gs
