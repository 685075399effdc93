// SPDX-License-Identifier: Apache-2.0
// `gsapp bench precision`: what each precision costs, and how far its frames are from those in double.
#include <cstdio>
#include <memory>

#include "apps/gsapp/bench.h"
#include "apps/gsapp/printing.h"
#include "eval/bench/bench_cases.h"
#include "eval/bench/precision.h"
#include "eval/runs/bench_subject.h"
#include "lib/core/options_cli.h"

namespace gs {
namespace {

struct PrecisionArguments {
    BenchRepeats repeats;
    std::string file;  ///< a point cloud without a run; empty: none
    std::int64_t iteration = -1;
    bool json = false;
};

void bench_precision(const TrainArguments& train, const PrecisionArguments& arguments) {
    const TrainOptions options = measured_options(train, arguments.file);
    prepare_bench(options);
    const BenchOptions bench = bench_options(options.device, arguments.repeats.repeat, arguments.repeats.frame_repeat);
    const BenchSubject subject = bench_subject(options, saved_iteration(arguments.iteration));
    const std::vector<PrecisionRow> rows = measure_precision(options, subject.scene, subject.model, bench);
    const std::string text = arguments.json ? precision_json(subject.name, rows)
                                            : subject.name + "\n\n" + table_text(precision_table(rows), stdout_style());
    std::fputs(text.c_str(), stdout);
}

}  // namespace

void add_bench_precision_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "precision",
        "Measure time, memory and error against double precision at every precision that options choose, "
        "of the trained model in -m RUN or in a .ply file, or of a scene's initial points");
    const auto arguments = std::make_shared<PrecisionArguments>();
    add_point_cloud_option(*command, arguments->file);
    const auto train = std::make_shared<TrainArguments>(*command);
    add_repeat_option(*command, arguments->repeats);
    add_frame_repeat_option(*command, arguments->repeats);
    add_iteration_option(*command, arguments->iteration);
    add_json_flag(*command, arguments->json);
    command->callback(
        [train, arguments, &selected] { selected = [train, arguments] { bench_precision(*train, *arguments); }; });
}

}  // namespace gs
