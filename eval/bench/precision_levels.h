// SPDX-License-Identifier: Apache-2.0
// Named settings of accuracy and speed.
#pragma once

#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

/// One level and the options that it changes.
struct PrecisionLevel {
    std::string name;
    bool gpu_only;
    void (*apply)(TrainOptions&);  ///< changes options whose precision is the default
};

/// Returns all levels; the first one is the default.
const std::vector<PrecisionLevel>& precision_levels();

/// Returns the level of that name. Throws UsageError naming the known ones for another name.
const PrecisionLevel& precision_level(const std::string& name);

}  // namespace gs
