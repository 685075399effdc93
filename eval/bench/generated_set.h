// SPDX-License-Identifier: Apache-2.0
// Generates Gaussians, cameras and a scene without data, so that speed can be measured at any scale.
#pragma once

#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns `count` Gaussians in and near the unit ball; each is a function of (seed, index) alone. 85 % lie within
/// 0.005 of the surfaces of sixteen spheres, the others anywhere in the ball. Scales are 0.5 count^(-1/3) times a
/// lognormal for each axis. Half of the Gaussians are mostly transparent, half mostly opaque. Rotations are uniform.
/// Residuals are the model's initial values plus normals of 0.05. All degrees are active.
Gaussians generated_gaussians(std::int64_t count, std::uint64_t seed, const AppearanceSpec& appearance);

/// Returns eight cameras of 1280x720 pixels around the ball.
std::vector<Camera> generated_cameras();

/// Returns a scene of training views from these cameras. Their images are 8-bit renders of the model that `backend`
/// holds.
Scene generated_scene(Backend& backend, const Vec3<float>& background);

}  // namespace gs
