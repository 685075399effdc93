// SPDX-License-Identifier: Apache-2.0
// `gsapp bench stability`: numerical errors of the appearance models at the extremes.
#include <cstdio>
#include <memory>

#include "apps/gsapp/bench.h"
#include "apps/gsapp/printing.h"
#include "eval/bench/stability.h"

namespace gs {

void add_bench_stability_command(CLI::App& bench, Command& selected) {
    CLI::App* command = bench.add_subcommand(
        "stability",
        "Measure the numerical errors of every appearance model at extreme inputs; needs no scene and no GPU");
    const auto json = std::make_shared<bool>(false);
    add_json_flag(*command, *json);
    command->add_flag("-q,--quiet")->description("Taken as by the other commands; there are no messages here");
    command->callback([json, &selected] {
        selected = [json] {
            const std::vector<StabilityRow> rows = measure_stability();
            std::fputs((*json ? stability_json(rows) : table_text(stability_table(rows), stdout_style())).c_str(),
                       stdout);
        };
    });
}

}  // namespace gs
