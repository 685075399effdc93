// SPDX-License-Identifier: Apache-2.0
// Settings that trade accuracy for speed, by name.
#pragma once

#include <string>
#include <vector>

#include "lib/core/train_options.h"

namespace gs {

struct PrecisionLevel {
    std::string name;
    bool gpu_only;
    void (*apply)(TrainOptions&);  ///< on options whose precision is the default
};

/// The first one is the default.
const std::vector<PrecisionLevel>& precision_levels();

/// Throws UsageError naming those there are.
const PrecisionLevel& precision_level(const std::string& name);

}  // namespace gs
