// SPDX-License-Identifier: Apache-2.0
// Measures a training iteration and a frame, stage by stage, against the machine's peak rates.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// The factor on all rates. Adam moves parameters by the rate whatever the gradient is, and hundreds of such steps
/// without the moments of a real run would change the model that is measured.
inline constexpr double kFrozenRates = 1e-6;

/// The numbers of repetitions.
struct BenchOptions {
    int repeat = 20;       ///< iterations in one measurement
    int frame_repeat = 3;  ///< rounds through all views when frames are timed
};

/// The mean time of frames of one size.
struct FrameTime {
    int width = 0, height = 0;  ///< size of the first view, px
    int num_views = 0;
    double seconds = 0;  ///< mean time of a frame
};

/// The measurements of run_bench. Times are in seconds.
struct BenchResult {
    std::string subject;  ///< name of the measured model and scene, for readers
    std::string device;
    Ceilings ceilings;
    std::int64_t num_gaussians = 0;
    int width = 0, height = 0;  ///< size of the first training view, px
    int repeat = 0;
    std::vector<FrameTime> frames;            ///< times at the views' own size, and at 1280x720 where that differs
    double iteration_seconds = 0;             ///< mean of steps in a row, without densification
    double iteration_seconds_median = 0;      ///< median of steps that are each waited for
    std::vector<StageCost> stages;            ///< costs per iteration, on the same views
    std::vector<StageCost> without_residual;  ///< costs at degree 0; empty for a model without a residual
    MemoryUse memory;                         ///< use at the end
    std::optional<double> default_seconds, deterministic_seconds;  ///< mean of an iteration, if both were measured
};

/// Returns the model that training would begin with, with all degrees active.
Gaussians initial_model(const TrainOptions& options, const Scene& scene);

/// Uploads `model` and measures it on the views of `scene`. Frames are timed on the test views (the training views
/// if there are none), iterations on training views in turn, spread over the scene. Images are decoded, and the
/// device has seen each of them once, before the clock starts. Learning rates and noise are a millionth of those of
/// `options`, so that the work is the same and the model stays what it was.
BenchResult run_bench(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                      const BenchOptions& bench);

/// Returns the mean seconds of a frame over `repeats` rounds through the views at their own size.
double frame_seconds(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, int repeats);

/// Uploads `model` and measures BenchResult::iteration_seconds alone.
double iteration_seconds(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                         const BenchOptions& bench);

/// Returns the time, bytes and operations that the residual adds to stage `k`: the stage less itself at degree 0.
StageCost appearance_share(const BenchResult& result, std::size_t k);

/// Writes the result as text: frames, iterations, and one line a stage with time, items, time per item, floor and
/// measured/floor. The floor is the longer of least bytes / copy bandwidth and least operations / FMA rate. A stage
/// above three floors is marked, and the reason that the backend gives stands below the table. The share of the
/// appearance model in the stages that evaluate it follows.
std::string format_bench(const BenchResult& result, TableStyle style = TableStyle::kMarkdown);

/// Returns all figures of the results as one JSON object, times in seconds.
std::string bench_json(const std::vector<BenchResult>& results);

}  // namespace gs
