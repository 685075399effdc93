// SPDX-License-Identifier: Apache-2.0
// Moves a model into a frame.
#pragma once

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Moves Gaussians from scene coordinates into the frame: their means and their logarithmic scales. Rows that leave the
/// range of floats become infinite. There must be no moments.
void bring_into_frame(Gaussians& gaussians, const Frame& frame);

}  // namespace gs
