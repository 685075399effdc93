// SPDX-License-Identifier: Apache-2.0
// Measures a training iteration and a frame, stage by stage, and compares them with the machine's peak rates.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "eval/pages/text_table.h"
#include "kernels/ranks/backend.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Factor on all learning rates. Adam moves parameters by the rate regardless of the gradient's magnitude, and without
/// the moments of a real run hundreds of full steps would change the measured model.
inline constexpr double kFrozenRates = 1e-6;

/// The numbers of repetitions.
struct BenchOptions {
    int repeat = 20;       ///< iterations per measurement
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
    std::vector<FrameTime> frames;            ///< times at the views' own size, and at 1280x720 if that differs
    double iteration_seconds = 0;             ///< mean of consecutive steps, without densification
    double iteration_seconds_median = 0;      ///< median of steps, each waited for
    std::vector<StageCost> stages;            ///< costs per iteration, on the same views
    std::vector<StageCost> without_residual;  ///< costs at degree 0; empty for a model without a residual
    MemoryUse memory;                         ///< memory use at the end
    /// Mean time of an iteration in both modes; set if both were measured.
    std::optional<double> default_seconds, deterministic_seconds;
};

/// Returns the initial model of a training, with all degrees active.
Gaussians initial_model(const TrainOptions& options, const Scene& scene);

/// Uploads `model` and measures it on the views of `scene`. Frames are timed on the test views (the training views if
/// there are none), iterations on training views in turn, spread over the scene. Before timing starts, images are
/// decoded, and the device has processed each of them once. Learning rates and noise are a millionth of those of
/// `options`, so that the work is the same and the model stays unchanged.
BenchResult run_bench(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                      const BenchOptions& bench);

/// Returns the mean time of a frame, s, over `repeats` rounds through the views at their own size.
double frame_seconds(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, int repeats);

/// Uploads `model` and measures BenchResult::iteration_seconds alone.
double iteration_seconds(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                         const BenchOptions& bench);

/// Returns the time, bytes and operations that the residual adds to stage `k`: the stage minus the same stage at degree
/// 0.
StageCost appearance_share(const BenchResult& result, std::size_t k);

/// Returns the result as text: frames, iterations, and one line per stage with time, items, time per item, floor and
/// measured/floor. The floor is the larger of least bytes / copy bandwidth and least operations / FMA rate. A stage
/// above three floors is marked, and the backend's reason is given below the table. The share of the appearance model
/// in the stages that evaluate it follows.
std::string format_bench(const BenchResult& result, TableStyle style = TableStyle::kMarkdown);

/// Returns all measurements as one JSON object, times in seconds.
std::string bench_json(const std::vector<BenchResult>& results);

}  // namespace gs
