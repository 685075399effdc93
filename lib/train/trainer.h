// SPDX-License-Identifier: Apache-2.0
// The training loop: from a scene and options to a run folder with a trained model.
#pragma once

#include <cstdint>
#include <functional>

#include "kernels/backend.h"
#include "lib/core/progress.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/run_start.h"

namespace gs {

struct TrainHooks {
    /// Called after `iteration` iterations where options.test_iterations lists it, and at the end with the pruned model.
    /// Its time does not count as training time.
    std::function<void(std::int64_t iteration, Backend& backend)> evaluate;
    /// Takes the place of choose_backend where set.
    std::function<std::unique_ptr<Backend>(const AppearanceSpec&, const BackendOptions&)> make_backend;
};

struct TrainSummary {
    std::int64_t iterations = 0;
    std::int64_t num_gaussians = 0;   ///< after the final pruning: the #Gs of tables
    double train_seconds = 0;         ///< of the loop until its last step was done; without loading, saving and evaluation
    double data_wait_seconds = 0;     ///< part of it spent waiting for images
    MemoryUse memory;                 ///< of the device at the end of the loop; empty on the CPU
    double controller_seconds = 0;    ///< of the PPISP controllers, after train_seconds; 0 where none were trained
    std::string photometric;          ///< what --ppisp auto decided, with its figure; empty where nothing was to decide in this part of the run
};

/// Trains until options.iterations, then the PPISP controllers, and writes config.yaml, cfg_args, cameras.json, input.ply,
/// stats/train.jsonl, ppisp.json, checkpoints and point clouds. On the CPU, and with options.deterministic on one GPU, bitwise reproducible for equal
/// options, also across a resume and for any number of threads. Throws NumericError when parameters or losses stay
/// non-finite, Interrupted after the checkpoint that Ctrl-C asked for, DeviceError when memory ran out: if an iteration had
/// been done and the model can still be read, after writing a checkpoint that the message names. (A densification done for
/// the iteration that failed is done once more by the resumed run.)
TrainSummary train(const TrainOptions& options, const Scene& scene, RunStart start, Progress& progress, const TrainHooks& hooks);

}  // namespace gs
