// SPDX-License-Identifier: Apache-2.0
// `gsapp bench stability`: numerical errors of the appearance models at the extremes.
#include <cstdio>

#include "apps/gsapp/bench.h"
#include "eval/bench/stability.h"

namespace gs {

void add_bench_stability_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "stability",
        "Measure the numerical errors of every appearance model at extreme inputs; needs no scene and no GPU");
    command->add_flag("--stability")->group("");  // the old spelling of the subcommand
    command->callback([&selected] {
        selected = [] { std::fputs(markdown_table(stability_table(measure_stability())).c_str(), stdout); };
    });
}

}  // namespace gs
