// SPDX-License-Identifier: Apache-2.0
// Which Gaussians of a model show view dependence.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/model/gaussian_state.h"
#include "kernels/splat/camera.h"

namespace gs {

/// Marks (1) the Gaussians whose residual changes their colour by more than half an 8-bit step, 0.5/255, in a channel
/// for a camera that draws any part of them; one value per row. The bound does not depend on opacity: the weights of a
/// pixel's Gaussians add up to at most 1, so no pixel of these cameras changes by more than half a step whichever of
/// the others lose their residual. Throws UsageError for a model without residuals.
std::vector<std::uint8_t> shown_residuals(const Gaussians& gaussians, const std::vector<CameraParams<float>>& cameras);

}  // namespace gs
