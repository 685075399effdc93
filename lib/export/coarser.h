// SPDX-License-Identifier: Apache-2.0
// Makes a model of fewer Gaussians that shows nearly the same.
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

}  // namespace gs
