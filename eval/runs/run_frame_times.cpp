// SPDX-License-Identifier: Apache-2.0
// Opens or generates what is timed.
#include "eval/runs/run_frame_times.h"

#include "eval/bench/generated_set.h"
#include "eval/runs/results.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"

namespace gs {

FrameTimesLine time_run_frames(const std::string& folder, std::optional<std::int64_t> iteration,
                               const RunChanges& instead, int frames_per_view) {
    const SavedRun run = open_saved_run(folder, iteration, instead);
    const RunFacts facts = run_facts(run.options, run.scene, run.background, *run.backend);
    const std::vector<View>& views = run.scene.test.empty() ? run.scene.train : run.scene.test;
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    log_info("{}: iteration {}, {} Gaussians, {} {} views", folder, run.iteration, facts.num_gaussians, cameras.size(),
             run.scene.test.empty() ? "training" : "test");
    const FrameTimes times = measure_frame_times(*run.backend, cameras, run.background, frames_per_view);
    if (!is_point_cloud(run.folder)) write_frame_times(RunFolder{run.folder}, run.iteration, times);
    return {folder, facts.scene, facts.model, facts.num_gaussians, times};
}

FrameTimesLine time_generated_frames(std::int64_t count, const TrainOptions& options, int frames_per_view) {
    const AppearanceSpec appearance = appearance_spec(options);
    const auto backend = choose_backend(options.device, appearance, backend_options(options));
    backend->upload(generated_gaussians(count, options.seed, appearance));
    return {"-", "generated", options.appearance, count,
            measure_frame_times(*backend, generated_cameras(), options.background.color, frames_per_view)};
}

}  // namespace gs
