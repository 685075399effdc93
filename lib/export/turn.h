// SPDX-License-Identifier: Apache-2.0
// Rotates a model about the origin, for readers that expect a certain axis to point up.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the up direction, assuming that cameras are held level: the direction most nearly perpendicular to their
/// horizontal axes, on the side of the cameras' mean up vector. If these axes do not determine it (cameras side by
/// side, or too few), returns the mean up vector, normalized. If the photographs of all cameras lie on their side,
/// their vertical axes are horizontal in the scene, and the result's sign is such that the cameras look down rather
/// than up. Returns nothing without cameras, and if the mean is zero.
std::optional<Eigen::Vector3d> find_up(const std::vector<Camera>& cameras);

/// Returns the result of find_up. Throws UsageError if it is empty.
Eigen::Vector3d up_direction(const std::vector<Camera>& cameras);

/// Returns the rotation that takes `up` to the unit vector `axis` (along y or z). It first rotates by a multiple of 90
/// degrees, so that a scene whose up direction is another coordinate axis is rotated exactly.
Eigen::Matrix3d turn_to(const Eigen::Vector3d& up, const Eigen::Vector3d& axis);

/// Returns the matrix M that maps the coefficients c of bands 1..`degree` (1..3) of a function of the direction to the
/// coefficients of the rotated function: Y(R d) . (M c) = Y(d) . c.
Eigen::MatrixXd sh_turn(const Eigen::Matrix3d& rotation, int degree);

/// Rotates means, rotations and spherical harmonics about the origin. Throws UsageError for a model with another kind
/// of view dependence (see ModelInfo::plain_sh).
void turn(Gaussians& gaussians, const Eigen::Matrix3d& rotation);

/// Returns the camera that sees the rotated scene as `camera` sees the scene.
Camera turned(Camera camera, const Eigen::Matrix3d& rotation);

}  // namespace gs
