// SPDX-License-Identifier: Apache-2.0
// What is asked of or done to all Gaussians of a model at once: their centre, another frame, and which numbers they may
// have. Converters write infinities for what is fully opaque or flat.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the median of the Gaussians' positions for each axis, frame units; a few distant ones do not move it. Zero
/// without Gaussians.
Eigen::Vector3d median_center(const Gaussians& gaussians);

/// Moves Gaussians from scene coordinates into the frame: their means and their logarithmic scales. Rows that leave the
/// range of floats become infinite. There must be no moments.
void bring_into_frame(Gaussians& gaussians, const Frame& frame);

/// Returns whether a raw parameter of the group has a meaning: it is finite, or an infinity whose activation has a
/// limit. An opacity of +-infinity is 1 or 0, and a log scale of -infinity is an axis without extent.
bool has_meaning(Group group, float raw);

/// Replaces infinite parameters, which have no gradient, by finite ones that a training can begin with: the largest
/// opacity that trainings keep (kMaxRawOpacity), its opposite, and the least scale that files for viewers hold. Returns
/// the number of Gaussians that were changed.
std::int64_t make_trainable(Gaussians& gaussians);

}  // namespace gs
