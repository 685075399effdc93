// SPDX-License-Identifier: Apache-2.0
// The 3-D filter of a whole model on the host (docs/math/rasterizer.md#antialiasing).
#pragma once

#include <vector>

#include "kernels/splat/camera.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Makes the 3-D filter a part of scales and opacities, and removes it. All views of the model stay as they were.
/// Leaves moments unchanged.
void merge_smoothing(Gaussians& model);

/// Makes a model without a 3-D filter antialiased, with the filter for `cameras`, the training views. If it already was
/// antialiased, the filter is taken out of scales and opacities, and views stay as they were, except of Gaussians
/// smaller than the filter, which no training with these views has made. Else scales become at least as large as the
/// filter: smaller Gaussians, like the first ones of MCMC, would be too faint to learn. Leaves moments unchanged.
void add_smoothing(Gaussians& model, const std::vector<CameraParams<float>>& cameras);

}  // namespace gs
