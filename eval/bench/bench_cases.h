// SPDX-License-Identifier: Apache-2.0
// The measurements of `gsapp bench`: one model on one scene, and generated sets, whose Gaussians, cameras and scene
// need no data, so that speed can be measured at any scale.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "eval/bench/bench.h"
#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Returns `count` Gaussians in and near the unit ball; each depends only on (seed, index). 85 % lie within 0.005 of
/// the surfaces of sixteen spheres, the others anywhere in the ball. Scales are 0.5 count^(-1/3) times a lognormal
/// factor per axis. Half of the Gaussians are mostly transparent, half mostly opaque. Rotations are uniform. Residuals
/// are the model's initial values plus normal noise of deviation 0.05. All degrees are active.
Gaussians generated_gaussians(std::int64_t count, std::uint64_t seed, const AppearanceSpec& appearance);

/// Returns eight cameras of 1280x720 pixels around the ball.
std::vector<Camera> generated_cameras();

/// Returns a scene of training views from the generated cameras. Their images are 8-bit renders of the model that
/// `backend` holds.
Scene generated_scene(Backend& backend, const Vec3<float>& background);

/// Returns the numbers of repetitions on `device`; 0 means the device's default. A GPU needs many short steps for one
/// reliable number; on the CPU the same number of steps would take minutes.
BenchOptions bench_options(Device device, int repeat, int frame_repeat);

/// Calls run_bench. With `compare_deterministic` also times iterations with the opposite setting of --deterministic, on
/// a separate backend.
BenchResult bench_model(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                        const BenchOptions& bench, bool compare_deterministic);

/// Measures a generated set of `count` Gaussians as bench_model does. `backend` must have the appearance of `options`.
BenchResult bench_generated(Backend& backend, const TrainOptions& options, std::int64_t count,
                            const BenchOptions& bench, bool compare_deterministic);

}  // namespace gs
