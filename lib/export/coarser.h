// SPDX-License-Identifier: Apache-2.0
// Makes models of fewer Gaussians that show nearly the same, for devices without the memory or the speed for all of
// them.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// A coarser model, and what its Gaussians are worth: the sums of the scores of what was merged, one per row.
struct CoarserModel {
    Gaussians gaussians;
    std::vector<float> scores;
};

/// Returns a model of `count` Gaussians (1 to those of `model`). The ones with the highest scores (Backend::scores, one
/// per row) stay, in their order. Of the others those that hardly show are left out, and each of the rest is merged
/// into the most similar of its neighbours that stay: the merged one has the moments and the base colour of both,
/// weighted by score, as much opacity times area as both, and its own residual. Rows of equal scores stay in their
/// order. The optimizer state is dropped. docs/lab/viewer.md#levels-of-detail has what else was tried.
CoarserModel coarser_model(const Gaussians& model, const std::vector<float>& scores, std::int64_t count);

/// The most levels beside the whole model. Each has half the Gaussians of the one before.
inline constexpr int kMostLevels = 4;

/// Returns the numbers of Gaussians of the levels of a model with `count`: halves as long as they have at least those
/// that the textures of a file have room for anyway (ngsplat_unit), so that a coarser level is a smaller file.
std::vector<std::int64_t> level_counts(std::int64_t count);

/// Returns the levels of `model`, the largest first; `scores` has one value per row (Backend::scores).
std::vector<CoarserModel> coarser_levels(const Gaussians& model, const std::vector<float>& scores);

}  // namespace gs
