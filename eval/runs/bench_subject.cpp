// SPDX-License-Identifier: Apache-2.0
// Reads a trained model or creates the initial one, and opens or generates the models that are timed.
#include "eval/runs/bench_subject.h"

#include <fmt/format.h>

#include "eval/bench/bench.h"
#include "eval/bench/bench_cases.h"
#include "eval/runs/results.h"
#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/whole_model.h"
#include "lib/scene/scene.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {

BenchSubject bench_subject(const TrainOptions& options, std::optional<std::int64_t> iteration) {
    const bool trained = holds_model(options.model);
    if (iteration && !trained)
        throw UsageError("--iteration: there is no trained model in '" + options.model + "'; name its folder with -m");
    BenchSubject subject{options.source + ", initial points", {}, {}};
    if (trained) {  // read before the slow scene, so that errors appear early
        SavedModel saved = read_saved_model(options.model, iteration);
        subject.scene = load_scene_of(saved, options);
        subject.model = std::move(saved.state);
        make_trainable(subject.model);  // iterations are measured, too
        subject.model.active_degree = subject.model.appearance.max_degree;
        subject.name = fmt::format("{}, {}", options.source, options.model);
        if (!is_point_cloud(options.model)) subject.name += fmt::format(" at iteration {}", saved.iteration);
    }
    if (!trained) subject.scene = load_scene(options);
    if (subject.scene.train.empty())
        throw DataError(subject.scene.source + ": no training views (all were held out or skipped)");
    if (!trained) subject.model = initial_model(options, subject.scene);
    return subject;
}

FrameTimesLine time_run_frames(const std::string& folder, std::optional<std::int64_t> iteration,
                               const RunChanges& instead, int frames_per_view) {
    const SavedRun run = open_saved_run(folder, iteration, instead);
    RunResult result;
    add_run_facts(result, run.options, run.scene, *run.backend);
    const std::vector<View>& views = run.scene.test.empty() ? run.scene.train : run.scene.test;
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    log_info("{}: iteration {}, {} Gaussians, {} {} views", folder, run.iteration, run.backend->count(), cameras.size(),
             run.scene.test.empty() ? "training" : "test");
    const FrameTimes times = measure_frame_times(*run.backend, cameras, run.background, frames_per_view);
    if (!is_point_cloud(run.folder)) write_frame_times(RunFolder{run.folder}, run.iteration, times);
    return {folder, result.scene, result.model, result.num_gaussians, times};
}

FrameTimesLine time_generated_frames(std::int64_t count, const TrainOptions& options, int frames_per_view) {
    const AppearanceSpec appearance = appearance_spec(options);
    const auto backend = make_backend(options.device, appearance, engine_options(options));
    log_device(options.device, *backend);
    backend->upload(generated_gaussians(count, options.seed, appearance));
    return {"-", "generated", options.appearance, count,
            measure_frame_times(*backend, generated_cameras(), options.background.color, frames_per_view)};
}

}  // namespace gs
