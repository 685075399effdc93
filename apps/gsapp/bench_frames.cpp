// SPDX-License-Identifier: Apache-2.0
// `gsapp bench frames`: frame times of finished runs and of generated sets, in one table.
#include <algorithm>
#include <cstdio>
#include <memory>

#include "appearance/model_info.h"
#include "apps/gsapp/bench.h"
#include "apps/gsapp/printing.h"
#include "eval/bench/bench_cases.h"
#include "eval/runs/run_frame_times.h"
#include "kernels/base/error.h"
#include "lib/core/options_cli.h"

namespace gs {
namespace {

struct FramesArguments {
    std::vector<std::string> runs;
    std::int64_t iteration = -1;
    std::vector<std::int64_t> generate;
    std::vector<std::string> appearances;  ///< empty = all
    BenchRepeats repeats;
    bool json = false;
};

void bench_frames(const TrainArguments& train, const FramesArguments& arguments) {
    const std::vector<std::string>& runs = arguments.runs;
    const TrainOptions options = train.resolve({.stored_run = false, .default_source = "generated"});
    prepare_bench(options);
    if (runs.empty() && arguments.generate.empty())
        throw UsageError("bench frames: name folders of runs, or sizes of generated sets with --generate");
    const int frames_per_view = bench_options(options.device, 0, arguments.repeats.frame_repeat).frame_repeat;
    std::vector<FrameTimesLine> lines;
    RunChanges of_files{.device = options.device, .point_cloud = options};
    of_files.point_cloud->source = train.combine().source;
    // Beside point clouds it is theirs; otherwise it is where the runs' scene is now.
    if (std::none_of(runs.begin(), runs.end(), is_point_cloud)) of_files.source = of_files.point_cloud->source;
    for (const std::string& run : runs)
        lines.push_back(time_run_frames(run, saved_iteration(arguments.iteration), of_files, frames_per_view));
    for (const std::int64_t count : arguments.generate)
        for (const std::string& appearance :
             arguments.appearances.empty() ? appearance_names() : arguments.appearances) {
            TrainOptions with = options;
            with.appearance = appearance;
            lines.push_back(time_generated_frames(count, with, frames_per_view));
        }
    const std::string text = arguments.json
                                 ? frame_times_json(lines)
                                 : table_text(frame_times_table(lines), stdout_style()) + "\n" + kFrameProtocol + "\n";
    std::fputs(text.c_str(), stdout);
}

}  // namespace

void add_bench_frames_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "frames",
        "Time frames of runs at 1280x720 pixels, view by view; print one table and add the times to the "
        "runs' results.json");
    const auto arguments = std::make_shared<FramesArguments>();
    // Declared before the scene, which may stand without a flag, too.
    command->add_option("runs", arguments->runs, "Run folders, or .ply files with the scene of their views in -s")
        ->type_name("RUN|FILE.ply");
    const auto train = std::make_shared<TrainArguments>(*command);
    add_iteration_option(*command, arguments->iteration);
    add_generate_option(*command, arguments->generate);
    command
        ->add_option("--appearances", arguments->appearances,
                     "Appearance models of the generated sets, each with the same Gaussians (default: all)")
        ->delimiter(',');
    add_frame_repeat_option(*command, arguments->repeats);
    add_json_flag(*command, arguments->json);
    command->callback(
        [train, arguments, &selected] { selected = [train, arguments] { bench_frames(*train, *arguments); }; });
}

}  // namespace gs
