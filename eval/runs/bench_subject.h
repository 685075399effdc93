// SPDX-License-Identifier: Apache-2.0
// What `gsapp bench` measures: a scene with the trained model of a run, or with the model that training would begin
// with, and the frame times of finished runs and of generated sets.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "eval/bench/frame_times.h"
#include "eval/runs/saved_run.h"
#include "kernels/state/gaussian_state.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// A scene with the trained model of a run, or with the model that training would begin with.
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

/// Opens the run in `folder` at `iteration` (empty: the last saved one), or a point cloud without a run, with the
/// changes `instead`, and times its test views, or its training views where none were held out, by
/// measure_frame_times. Also writes what it measured to the run's results.json. Throws what open_saved_run throws.
FrameTimesLine time_run_frames(const std::string& folder, std::optional<std::int64_t> iteration,
                               const RunChanges& instead, int frames_per_view);

/// Times a generated set (eval/bench/bench_cases.h) of `count` Gaussians of the options' appearance. `options` are
/// checked; device, background, seed and the appearance's own options count.
FrameTimesLine time_generated_frames(std::int64_t count, const TrainOptions& options, int frames_per_view);

}  // namespace gs
