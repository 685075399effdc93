// SPDX-License-Identifier: Apache-2.0
// Takes the parameters of view dependence from Gaussians that show none.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/model/gaussian_state.h"
#include "kernels/splat/camera.h"

namespace gs {

/// Sets the residual of a Gaussian to zero where it changes the colour by at most half an 8-bit step, 0.5/255, in each
/// channel for every camera that draws any part of the Gaussian. Gaussians that no camera draws are cleared, too.
/// Returns how many were cleared; `gaussians` is otherwise left as it is. The bound does not depend on opacity: the
/// weights of a pixel's Gaussians add up to at most 1, so no pixel of these cameras changes by more than half a step
/// whichever Gaussians are cleared. Throws UsageError for a model without residuals, and for one in which a single
/// Gaussian's residual cannot be zero.
std::int64_t prune_residuals(Gaussians& gaussians, const std::vector<CameraParams<float>>& cameras);

}  // namespace gs
