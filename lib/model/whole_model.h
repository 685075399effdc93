// SPDX-License-Identifier: Apache-2.0
// Functions on all Gaussians of a model: their centre, the change to another frame, and the validity of their
// parameters. Converters write infinities for fully opaque or flat Gaussians.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the median of the Gaussians' positions per axis, in frame units, which is insensitive to a few distant
/// Gaussians. Returns zero without Gaussians.
Eigen::Vector3d median_center(const Gaussians& gaussians);

/// Transforms the means and logarithmic scales of Gaussians from scene coordinates into the frame. Values beyond the
/// range of floats become infinite. The Gaussians must have no moments.
void bring_into_frame(Gaussians& gaussians, const Frame& frame);

/// Returns whether a raw parameter of the group has a meaning: it is finite, or an infinity at which the activation has
/// a limit. An opacity of +-infinity is 1 or 0, and a log scale of -infinity is an axis without extent.
bool has_meaning(Group group, float raw);

/// Replaces infinite parameters, which have no gradient, by finite values for the start of a training: the largest raw
/// opacity that trainings keep (kMaxRawOpacity), its negative, and the smallest scale in files for viewers. Returns the
/// number of Gaussians that were changed.
std::int64_t make_trainable(Gaussians& gaussians);

}  // namespace gs
