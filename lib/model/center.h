// SPDX-License-Identifier: Apache-2.0
// Finds the centre of a model.
#pragma once

#include <Eigen/Core>

#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns the median of the Gaussians' positions for each axis, frame units; a few distant ones do not move it. Zero
/// without Gaussians.
Eigen::Vector3d median_center(const Gaussians& gaussians);

}  // namespace gs
