// SPDX-License-Identifier: Apache-2.0
// `gsapp bench`: what an iteration and a frame cost on this machine.
#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/bench.h"
#include "lib/core/log.h"
#include "lib/core/options_cli.h"
#include "lib/train/scene_options.h"

namespace gs {

void add_bench_command(CLI::App& app, Command& selected) {
    CLI::App* command = app.add_subcommand("bench", "Measure iteration and frame times from a scene's initial points, stage by stage");
    const auto arguments = std::make_shared<TrainArguments>(*command);
    const auto bench = std::make_shared<BenchOptions>();
    command->add_option("--repeat", bench->iterations, "Iterations and frames to average over")->check(CLI::Range(1, 100000))->capture_default_str();
    command->callback([arguments, bench, &selected] {
        selected = [arguments, bench] {
            TrainOptions options = arguments->resolve();
            setup_log(options.quiet ? "warn" : options.log_level);
            bench->mcmc_init = options.strategy == "mcmc";
            const Scene scene = load_scene(scene_options(options));
            std::fputs(format_bench(run_bench(options, scene, *bench)).c_str(), stdout);
        };
    });
}

}  // namespace gs
