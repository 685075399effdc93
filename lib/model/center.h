// SPDX-License-Identifier: Apache-2.0
// Where a model is.
#pragma once

#include <Eigen/Core>

#include "kernels/model/gaussian_state.h"

namespace gs {

/// Median of the Gaussians' positions, axis by axis, which a few far away do not move. Zero without Gaussians.
Eigen::Vector3d median_center(const Gaussians& gaussians);

}  // namespace gs
