// SPDX-License-Identifier: Apache-2.0
// Loads the models that `gsapp bench` measures (the trained model of a run, or the initial model of a training) with
// their scene, and measures the frame times of finished runs and of generated sets.
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

/// A scene with the trained model of a run, or with the initial model of a training.
struct BenchSubject {
    std::string name;  ///< name for readers: "lego, output/lego at iteration 30000"
    Scene scene;
    Gaussians model;  ///< all degrees active
};

/// Returns the scene of checked `options` with the model in the folder or point cloud `options.model` at `iteration`
/// (empty: the last saved iteration), or with the scene's initial points if the folder holds no model. Throws
/// UsageError for an iteration without a model, DataError for a scene without training views, and the errors of
/// read_saved_model and load_scene.
BenchSubject bench_subject(const TrainOptions& options, std::optional<std::int64_t> iteration);

/// Opens the run in `folder` at `iteration` (empty: the last saved iteration), or a point cloud without a run, with the
/// changes `instead`. Times its test views (its training views if none were held out) with measure_frame_times. Also
/// writes the frame times to the run's results.json. Throws the errors of open_saved_run.
FrameTimesLine time_run_frames(const std::string& folder, std::optional<std::int64_t> iteration,
                               const RunChanges& instead, int frames_per_view);

/// Times a generated set (eval/bench/bench_cases.h) of `count` Gaussians with the appearance of `options`. `options`
/// are checked; only device, background, seed and the appearance's own options are used.
FrameTimesLine time_generated_frames(std::int64_t count, const TrainOptions& options, int frames_per_view);

}  // namespace gs
