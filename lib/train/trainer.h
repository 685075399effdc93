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
    std::int64_t num_gaussians = 0;  ///< after the final pruning; the #Gs of tables
    double residual_share = 1;       ///< share of these that have a residual, where the model has one
    /// The time of the loop until its last step was done, with that of the parts before a resume; without loading,
    /// saving and evaluation
    double train_seconds = 0;
    double data_wait_seconds = 0;  ///< part of train_seconds spent waiting for images
    MemoryUse memory;              ///< memory of the device at the end of the loop; empty on the CPU
    /// The time of the PPISP controllers, which is no part of train_seconds; 0 if none were trained
    double controller_seconds = 0;
    std::int64_t controller_iterations = 0;
    double saving_seconds = 0;   ///< final pruning and saving
    double frame_seconds = 0;    ///< of the final model at 1280x720, with options.frame_limit; else 0
    double limited_seconds = 0;  ///< what a time limit counts: from the first step to the end of saving; 0 without one
    std::optional<TargetOutcome> target = {};  ///< with options.target_psnr
    /// The decision of --ppisp auto, with its figure; empty if nothing was decided
    std::string photometric;
    /// False if the run was resumed from a checkpoint that does not say how long its iterations took: the two times
    /// above then count from there.
    bool whole_time = true;
};

/// Trains until options.iterations, for options.time_limit or until options.target_psnr is reached, then trains the
/// PPISP controllers, and writes config.yaml, cfg_args, cameras.json, input.ply, stats/train.jsonl, ppisp.json,
/// checkpoints and point clouds. On the CPU, and with options.deterministic on one GPU, the result is bitwise
/// reproducible for equal options, also across a resume and for any number of threads. Throws NumericError when
/// parameters or losses stay non-finite, Interrupted after the checkpoint that Ctrl-C asked for, DeviceError when
/// memory ran out, and DataError when an image cannot be read any more or a file cannot be written. In the last two
/// cases it first writes a checkpoint, which the message names, if an iteration was done and the model can still be
/// read. (If the failed iteration had already densified, the resumed run densifies once more; an image is asked for
/// before that.)
TrainSummary train(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress,
                   const TrainHooks& hooks);

}  // namespace gs
