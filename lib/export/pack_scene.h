// SPDX-License-Identifier: Apache-2.0
// From a trained model to the scene a viewer loads.
#pragma once

#include "kernels/model/gaussian_state.h"
#include "lib/export/ngsplat.h"
#include "lib/scene/scene.h"

namespace gs {

/// Throws NumericError naming group and row of the first parameter that is not finite.
void require_finite(const Gaussians& gaussians);

/// Gaussians that are ever visible, in their order: opacity at least 1/255 and a rotation with a direction.
Gaussians visible_gaussians(const Gaussians& gaussians);

/// Packs all of them: geometry and base colour to 16 bytes, the residual as its model says. 16 bytes and those of the payload per
/// Gaussian. Throws UsageError for a model that has no packing.
PackedScene pack_gaussians(const Gaussians& gaussians);

/// Test cameras, and from where to look first: the median of the means, the cameras' mean up, their median distance.
void add_cameras(PackedScene& scene, const Gaussians& gaussians, const std::vector<View>& test);

}  // namespace gs
