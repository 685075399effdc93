// SPDX-License-Identifier: Apache-2.0
// A stress test of training: a part of the first Gaussians gets extreme finite values.
#pragma once

#include <cstdint>

#include "kernels/model/gaussian_state.h"

namespace gs {

/// Sets every raw parameter but the mean of a share (0..1) of the Gaussians to an extreme: opacity +-50, each log scale
/// -30, 2 or 30, rotation components all +-1e-20, +-1e-3, +-1e3 or +-1e20, base colours all +-3 or all +-1e4, residuals
/// all +-1e-6, +-1e4 or +-1e30. The choice depends only on the seed and the row. Returns the number of changed
/// Gaussians.
std::int64_t make_hostile(Gaussians& state, double share, std::uint64_t seed);

}  // namespace gs
