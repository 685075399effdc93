// SPDX-License-Identifier: Apache-2.0
// Turns a model about the origin, for readers that expect a certain axis to point up.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "kernels/state/gaussian_state.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns the direction that points up where cameras are held level: the one to which their horizontal axes are most
/// nearly perpendicular, on the side of the cameras' mean up. Where these axes do not say (cameras side by side, or too
/// few) it is the mean up itself. If the photographs of all cameras lie on their side, their vertical axes are the
/// horizontal ones, and the cameras look down rather than up. Empty without cameras, and where the mean is zero.
std::optional<Eigen::Vector3d> find_up(const std::vector<Camera>& cameras);

/// Returns find_up. Throws UsageError if it is empty.
Eigen::Vector3d up_direction(const std::vector<Camera>& cameras);

/// Returns the rotation that takes `up` to the unit vector `axis` (along y or z). It turns by a multiple of 90 degrees
/// first, so that a scene whose axis is up already in another naming is turned exactly.
Eigen::Matrix3d turn_to(const Eigen::Vector3d& up, const Eigen::Vector3d& axis);

/// Returns the matrix that takes coefficients of the bands 1..`degree` (1..3) of a function of the direction to those
/// of the turned function: Y(R d) . (M c) = Y(d) . c.
Eigen::MatrixXd sh_turn(const Eigen::Matrix3d& rotation, int degree);

/// Turns means, rotations and spherical harmonics about the origin. Throws UsageError for a model whose colours depend
/// on the direction in another way (ModelInfo::plain_sh).
void turn(Gaussians& gaussians, const Eigen::Matrix3d& rotation);

/// Returns the camera that sees of the turned scene what `camera` sees of the scene.
Camera turned(Camera camera, const Eigen::Matrix3d& rotation);

}  // namespace gs
