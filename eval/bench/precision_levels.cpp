// SPDX-License-Identifier: Apache-2.0
// The options that each level sets.
#include "eval/bench/precision_levels.h"

#include <fmt/format.h>

#include "kernels/base/error.h"

namespace gs {

const std::vector<PrecisionLevel>& precision_levels() {
    // The cutoffs are twice (alpha) and ten times (transmittance) those of 3DGS.
    static const std::vector<PrecisionLevel> levels = {
        {"full", false, [](TrainOptions&) {}},
        {"fp32-moments", true, [](TrainOptions& o) { o.appearance_moments = AppearanceMoments::kFp32; }},
        {"half-storage", true, [](TrainOptions& o) { o.appearance_storage = AppearanceStorage::kFp16; }},
        {"cutoffs", false, [](TrainOptions& o) { o.alpha_cutoff = 2, o.transmittance_cutoff = 1e-3; }},
        {"fast", true,
         [](TrainOptions& o) {
             o.appearance_storage = AppearanceStorage::kFp16;
             o.alpha_cutoff = 2, o.transmittance_cutoff = 1e-3;
         }},
    };
    return levels;
}

const PrecisionLevel& precision_level(const std::string& name) {
    std::string names;
    for (const PrecisionLevel& level : precision_levels()) {
        if (level.name == name) return level;
        names += (names.empty() ? "" : ", ") + level.name;
    }
    throw UsageError(fmt::format("precision: '{}' is not one of {}", name, names));
}

}  // namespace gs
