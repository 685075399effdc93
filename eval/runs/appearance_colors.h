// SPDX-License-Identifier: Apache-2.0
// A model in colours that say how much the colour of each Gaussian depends on the view.
#pragma once

#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the model with one colour a Gaussian, and no correction: grey without a residual; else from blue to yellow
/// by the mean change of its colour over channels and up to 32 of `views`, yellow from a quarter on.
Gaussians appearance_colors(const Gaussians& model, const std::vector<View>& views);

}  // namespace gs
