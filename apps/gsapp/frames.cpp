// SPDX-License-Identifier: Apache-2.0
// Times the frames of runs and of generated sets, and prints one table.
#include "apps/gsapp/frames.h"

#include <cstdio>

#include "eval/bench/frame_times.h"
#include "eval/bench/generated_set.h"
#include "eval/runs/results.h"
#include "eval/runs/saved_run.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

FrameTimesLine time_run(const std::string& folder, const FramesArguments& arguments, Device device) {
    const SavedRun run = open_saved_run(folder, arguments.iteration, {.device = device});
    const RunFacts facts = run_facts(run.options, run.scene, run.background, run.backend->count());
    std::vector<Camera> cameras;
    for (const View& view : run.scene.test.empty() ? run.scene.train : run.scene.test) cameras.push_back(view.camera);
    log_info("{}: iteration {}, {} Gaussians, {} {} views", folder, run.iteration, facts.num_gaussians, cameras.size(), run.scene.test.empty() ? "training" : "test");
    const FrameTimes times = measure_frame_times(*run.backend, cameras, run.background, arguments.frames_per_view);
    write_frame_times(RunFolder{run.folder}, run.iteration, times);
    return {folder, facts.scene, facts.model, facts.num_gaussians, times};
}

FrameTimesLine time_generated(std::int64_t count, const FramesArguments& arguments, const TrainOptions& options) {
    const AppearanceSpec appearance = appearance_spec(options);
    const auto backend = choose_backend(options.device, appearance, backend_options(options));
    backend->upload(generated_gaussians(count, options.seed, appearance));
    return {"-", "generated", options.appearance, count, measure_frame_times(*backend, generated_cameras(), options.background.color, arguments.frames_per_view)};
}

}  // namespace

void run_frames(const FramesArguments& arguments, const TrainOptions& options) {
    std::vector<FrameTimesLine> lines;
    for (const std::string& run : arguments.runs) lines.push_back(time_run(run, arguments, options.device));
    for (const std::int64_t count : arguments.generate) {
        for (const std::string& appearance : arguments.appearances) {
            TrainOptions with = options;
            with.appearance = appearance;
            lines.push_back(time_generated(count, arguments, with));
        }
    }
    std::fputs((markdown_table(frame_times_table(lines)) + "\n" + kFrameProtocol + "\n").c_str(), stdout);
}

}  // namespace gs
