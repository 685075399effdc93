// SPDX-License-Identifier: Apache-2.0
// Trains a scene with the given options into a run folder.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/progress.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/run_start.h"
#include "lib/train/target_search.h"
#include "lib/train/train_hooks.h"
#include "lib/train/train_log.h"

namespace gs {

/// The result of a training.
struct TrainSummary {
    std::int64_t iterations = 0;
    std::int64_t num_gaussians = 0;  ///< number of Gaussians after the final pruning; column #Gs of tables
    double residual_share = 1;       ///< share of the Gaussians that have a residual; 1 for a model without residuals
    /// The time of the training loop until the end of its last step, including the parts before a resume, without
    /// loading, saving and evaluation
    double train_seconds = 0;
    double data_wait_seconds = 0;  ///< part of train_seconds spent waiting for images
    MemoryUse memory;              ///< memory of the device at the end of the loop; empty on the CPU
    /// The training time of the PPISP controllers, not part of train_seconds; 0 if none were trained
    double controller_seconds = 0;
    std::int64_t controller_iterations = 0;
    double saving_seconds = 0;   ///< time of final pruning and saving
    double frame_seconds = 0;    ///< render time of the final model at 1280x720, if options.frame_limit is set; else 0
    double limited_seconds = 0;  ///< time counted by a time limit: first step to end of saving; 0 without a limit
    std::optional<TargetOutcome> target = {};  ///< result of the search, if options.target_psnr is set
    /// The decision of --ppisp auto, with its measured value; empty if nothing was decided
    std::string photometric;
    std::string refine_cameras{};  ///< the decision of --refine-cameras auto, likewise
    /// False if the run was resumed from a checkpoint without training times. train_seconds and data_wait_seconds then
    /// count from there.
    bool whole_time = true;
};

/// Trains until options.iterations, for options.time_limit or until options.target_psnr is reached, then trains the
/// PPISP controllers, and writes config.yaml, cfg_args, cameras.json, input.ply, stats/train.jsonl, ppisp.json,
/// checkpoints and point clouds. On the CPU, and with options.deterministic on one GPU, the result is bitwise
/// reproducible for equal options, also across a resume and for any number of threads. Throws NumericError if
/// parameters or losses stay non-finite, Interrupted after writing the checkpoint for Ctrl-C, DeviceError if memory
/// runs out, and DataError if an image can no longer be read or a file cannot be written. In the last two cases it
/// first writes a checkpoint, which the message names, if an iteration was finished and the model can still be read.
/// (If the failed iteration had already densified, the resumed run densifies once more; images are read before
/// densification.)
TrainSummary train(const TrainOptions& options, Scene& scene, RunStart start, Progress& progress,
                   const TrainHooks& hooks);

}  // namespace gs
