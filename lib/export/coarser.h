// SPDX-License-Identifier: Apache-2.0
// Makes models of fewer Gaussians with nearly the same appearance, for devices without the memory or speed for all
// Gaussians.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// A coarser model and the scores of its Gaussians: the sums of the scores of the merged Gaussians, one per row.
struct CoarserModel {
    Gaussians gaussians;
    std::vector<float> scores;
};

/// Returns a model of `count` Gaussians (from 1 to the number in `model`). The Gaussians with the highest scores
/// (Backend::scores, one per row) stay, in their order. Of the others, the nearly invisible ones are left out, and each
/// of the rest is merged into the most similar of its staying neighbours. The merged Gaussian has the moments and the
/// base colour of both, weighted by score, the sum of their opacity times area, and the residual of the staying one.
/// Rows of equal scores keep their order. The optimizer state is dropped. docs/lab/viewer.md#levels-of-detail lists the
/// alternatives that were tried.
CoarserModel coarser_model(const Gaussians& model, const std::vector<float>& scores, std::int64_t count);

/// The largest number of levels besides the whole model. Each level has half the Gaussians of the previous one.
inline constexpr int kMostLevels = 4;

/// Returns the numbers of Gaussians in the levels of a model with `count` Gaussians: successive halves, at most
/// kMostLevels, each at least ngsplat_unit(). Smaller levels would not be smaller files, because textures have this
/// granularity.
std::vector<std::int64_t> level_counts(std::int64_t count);

/// Returns the levels of `model`, the largest first; `scores` has one value per row (Backend::scores).
std::vector<CoarserModel> coarser_levels(const Gaussians& model, const std::vector<float>& scores);

}  // namespace gs
