// SPDX-License-Identifier: Apache-2.0
// What a training iteration and a frame cost, stage by stage, against what the machine could do.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "kernels/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// The size at which renderers are usually compared.
constexpr int kFrameWidth = 1280, kFrameHeight = 720;

struct BenchOptions {
    int repeat = 20;       ///< iterations in one measurement
    int frame_repeat = 3;  ///< rounds through all views when frames are timed
};

struct FrameTime {
    int width = 0, height = 0;  ///< of the first view
    int num_views = 0;
    double seconds = 0;  ///< mean of a frame
};

struct BenchResult {
    std::string subject;  ///< what was measured, for the reader
    std::string device;
    Ceilings ceilings;
    std::int64_t num_gaussians = 0;
    int width = 0, height = 0;  ///< of the first training view
    int repeat = 0;
    std::vector<FrameTime> frames;              ///< at the views' own size, and at 1280x720 where that is another
    double iteration_seconds = 0;               ///< mean of steps in a row: forward, loss, backward, Adam; no densification
    double iteration_seconds_median = 0;        ///< of steps that are each waited for
    double marked_iteration_seconds = 0;        ///< mean of steps in a row while stages are timed
    std::vector<StageCost> stages;              ///< per iteration, of the marked steps
    std::vector<StageCost> without_residual;    ///< the same at degree 0; empty for a model without a residual
    MemoryUse memory;                           ///< afterwards
    std::optional<double> default_seconds, deterministic_seconds;  ///< of an iteration, where both were measured to compare
};

/// The model training would begin with, all degrees active.
Gaussians initial_model(const TrainOptions& options, const Scene& scene);

/// Uploads `model` and measures it on the views of `scene`: frames on the test views (the training views where there are
/// none), iterations on the training views in turn, spread over the scene. Images are decoded, and every image used is seen
/// once by the device, before the clock starts. Learning rates and noise are a millionth of those of `options`: the work is
/// the same, and the model that is measured last is the one that was measured first.
BenchResult run_bench(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model, const BenchOptions& bench);

/// Mean seconds of a frame over `repeats` rounds through the views at their own size.
double frame_seconds(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, int repeats);

/// Only BenchResult::iteration_seconds.
double iteration_seconds(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model, const BenchOptions& bench);

/// The same view direction and focal lengths in pixels at another image size, the centre of the image where it was:
/// cx + (width - W)/2, cy + (height - H)/2. A larger image therefore shows more of the scene, at the same scale.
Camera with_size(Camera camera, int width, int height);

/// What the residual adds to stage `k`: the stage less the same stage at degree 0, in time, bytes and operations.
StageCost appearance_share(const BenchResult& result, std::size_t k);

/// Markdown: frames, iterations, and one line a stage with time, items, time per item, floor and measured/floor. The floor is
/// the longer of least bytes / copy bandwidth and least operations / FMA rate. A stage above three times it is bold and
/// carries the reason that the backend gives. Then the share of the appearance
/// model in the stages that evaluate it.
std::string format_bench(const BenchResult& result);

}  // namespace gs
