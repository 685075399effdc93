// SPDX-License-Identifier: Apache-2.0
// Halves a model again and again.
#include "eval/runs/coarser_levels.h"

#include "lib/export/ngsplat.h"

namespace gs {

std::vector<std::int64_t> level_counts(std::int64_t count) {
    std::vector<std::int64_t> counts;
    for (count /= 2; counts.size() < std::size_t(kMostLevels) && count >= ngsplat_unit(); count /= 2)
        counts.push_back(count);
    return counts;
}

std::vector<CoarserModel> coarser_levels(const Gaussians& model, const std::vector<float>& scores) {
    std::vector<CoarserModel> levels;
    for (const std::int64_t count : level_counts(model.count)) levels.push_back(coarser_model(model, scores, count));
    return levels;
}

}  // namespace gs
