// SPDX-License-Identifier: Apache-2.0
// What `gsapp bench` measures: a scene with the trained model of a run, or with the model that training would begin
// with.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct BenchSubject {
    std::string name;  ///< for the reader: "lego, output/lego at iteration 30000"
    Scene scene;
    Gaussians model;  ///< all degrees active
};

/// Returns the scene of checked `options` with the model in the folder or point cloud `options.model` at `iteration`
/// (empty: the last saved one), or with the scene's initial points where the folder holds no model. Throws UsageError
/// for an iteration without a model, DataError for a scene without training views, and what read_saved_model and
/// load_scene throw.
BenchSubject bench_subject(const TrainOptions& options, std::optional<std::int64_t> iteration);

}  // namespace gs
