// SPDX-License-Identifier: Apache-2.0
// Sets of Gaussians of any size without data, so that speed can be measured at scale.
#pragma once

#include <vector>

#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// `count` Gaussians in the unit ball, a function of (seed, index) alone. Seventeen of twenty lie within half a hundredth of
/// the surfaces of sixteen spheres, the others anywhere in the ball. Scales are 0.5 count^(-1/3) times a lognormal, each
/// axis with its own; opacities are half of them mostly transparent and half mostly opaque; rotations are uniform; residuals
/// are the model's initial values plus normals of 0.05. All degrees are active.
Gaussians generated_gaussians(std::int64_t count, std::uint64_t seed, const AppearanceSpec& appearance);

/// Eight of 1280x720 pixels around the ball.
std::vector<Camera> generated_cameras();

/// Training views of these cameras, whose images are what `backend` renders now, as 8 bits.
Scene generated_scene(Backend& backend, const Vec3<float>& background);

}  // namespace gs
