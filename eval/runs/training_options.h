// SPDX-License-Identifier: Apache-2.0
// The options that make two runs the same experiment.
#pragma once

#include <map>
#include <string>

#include "lib/core/train_options.h"

namespace gs {

/// Returns the options that decide what a run becomes, as text by key: all but messages, folders, saving along the way
/// and the seed. Paths are resolved, so that one scene named in two ways counts as one. Two runs with equal maps
/// differ only by chance.
std::map<std::string, std::string> training_options(const TrainOptions& options);

}  // namespace gs
