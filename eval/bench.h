// SPDX-License-Identifier: Apache-2.0
// What a training iteration and a frame cost, stage by stage, against what the machine could do.
#pragma once

#include <string>
#include <vector>

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

struct BenchOptions {
    int iterations = 20;
    bool mcmc_init = false; ///< initial Gaussians a tenth of the neighbour distance large, as MCMC begins
};

struct BenchResult {
    Ceilings ceilings;
    std::string device;
    std::int64_t num_gaussians = 0;
    int width = 0, height = 0;
    double iteration_seconds = 0;      ///< mean of one step: forward, loss, backward, Adam; no densification
    double iteration_seconds_median = 0;
    double frame_seconds = 0;          ///< mean of one render
    std::vector<StageCost> stages;     ///< per iteration
};

/// Renders and trains on the views of `scene` in turn from the initial points (or `model`, if it has Gaussians), with all
/// degrees active and without densification; two warm-up iterations are not counted.
BenchResult run_bench(const TrainOptions& options, const Scene& scene, const BenchOptions& bench);

/// Markdown: one line a stage with time, items, time per item, floor and measured/floor.
std::string format_bench(const BenchResult& result);

}  // namespace gs
