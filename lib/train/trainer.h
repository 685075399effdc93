// SPDX-License-Identifier: Apache-2.0
// Trains a scene with the given options into a run folder.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "kernels/ranks/backend.h"
#include "lib/core/progress.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/run_start.h"
#include "lib/train/target_search.h"
#include "lib/train/train_log.h"

namespace gs {

/// The mean PSNR of held-out views and its standard error, dB.
struct HeldOutPsnr {
    double mean = 0, standard_error = 0;
};

/// The scores of test views.
struct TestScores {
    double psnr = 0, ssim = 0;  ///< means; PSNR in dB
    std::size_t views = 0;
};

/// What a watcher of a training may ask for.
enum class WatcherRequest {
    kNone,
    kSave,  ///< write a checkpoint and the point cloud
    kStop,  ///< as Ctrl-C: write a checkpoint and end
};

/// What a watcher of a training is told between two iterations. The loss is that of a step a little earlier.
struct TrainProgress {
    std::int64_t iteration = 0, num_gaussians = 0;
    std::int64_t expected_iterations = 0;  ///< of the whole run; 0 while time decides
    std::optional<double> seconds_left;    ///< of a time limit
    double loss = 0, train_seconds = 0;
    /// Reading the model now changes nothing of what follows: all its rows are up to date.
    bool rows_current = false;
};

struct TrainHooks {
    /// Called before the first iteration and after every one. It may wait; its time does not count as training time.
    std::function<WatcherRequest(const TrainProgress& progress, Backend& backend)> between;
    /// Called when kSave was done, with what went wrong, or an empty text. Set wherever `between` is.
    std::function<void(std::int64_t iteration, const std::string& error)> saved;
    /// Called after `iteration` iterations if options.test_iterations lists it, and at the end, with the pruned model
    /// and `last`. Its time does not count as training time. What it returns is written to the log.
    std::function<std::optional<TestScores>(std::int64_t iteration, Backend& backend, bool last)> evaluate;
    /// The most Gaussians that the final model may have; 0 = no limit but options.cap_max. Training has a tenth more,
    /// of which those with the lowest scores go at the end.
    std::int64_t most_gaussians = 0;
    /// Where the course of the training is shown, too; null: nowhere.
    TensorBoard* tensorboard = nullptr;
    /// With options.target_psnr: measures the views held out for it.
    std::function<HeldOutPsnr(Backend& backend)> held_out_psnr;
    /// Replaces choose_backend if set.
    std::function<std::unique_ptr<Backend>(const AppearanceSpec&, const EngineOptions&)> make_backend;
};

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
