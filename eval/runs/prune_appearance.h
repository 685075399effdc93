// SPDX-License-Identifier: Apache-2.0
// Takes the parameters of view dependence from Gaussians that show none.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/model/gaussian_state.h"
#include "kernels/splat/camera.h"

namespace gs {

/// Sets to zero the residual of every Gaussian whose colour it changes by at most half an 8-bit step, 0.5/255, in each channel and each of the
/// cameras that draw any part of it (so also of those that none of them draws), and returns how many these are. `gaussians` is otherwise left as it is.
/// Opacity does not scale the bound. The weights of a pixel's Gaussians add up to at most 1, so no pixel of these cameras changes by more than half
/// a step whichever Gaussians are pruned; with opacity, the share of each would have to be bounded together with all others it is blended with.
/// Throws UsageError for a model without residuals, and for one in which a single Gaussian's cannot be zero.
std::int64_t prune_residuals(Gaussians& gaussians, const std::vector<CameraParams<float>>& cameras);

}  // namespace gs
