// SPDX-License-Identifier: Apache-2.0
// gsapp eval: scores of finished runs, and a table over them.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/saved_run.h"
#include "eval/table.h"

namespace gs {
namespace {

struct EvalArguments {
    std::vector<std::string> runs;
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    std::string format = "markdown";
    std::string ssim_border = "valid";
    bool skip_render = false;
    bool decompose = false;
};

void evaluate_run(const std::string& folder, std::optional<std::int64_t> iteration, SsimBorder border, bool decompose) {
    SavedRun run = open_saved_run(folder, iteration);
    spdlog::info("{}: iteration {}, {} Gaussians, {} test views", folder, run.iteration, run.backend->count(), run.scene.test.size());
    const EvalOptions options{border, run.folder, run.iteration, "test", decompose};
    const EvalResult result = evaluate_views(*run.backend, run.scene.test, run.background, options);
    if (result.residual_mean) spdlog::info("{}: mean of the residual pictures {:.4f}", folder, *result.residual_mean);
    write_results(RunFolder{run.folder}, options, result, run_facts(run.options, run.scene, run.background, run.backend->count()));
}

void run_eval(const EvalArguments& arguments) {
    // Mistakes in the words are found before any run is rendered.
    const TableFormat format = parse_table_format(arguments.format);
    const SsimBorder border = parse_ssim_border(arguments.ssim_border);
    const auto iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration);
    std::vector<TableRow> rows;
    for (const std::string& run : arguments.runs) {
        if (!arguments.skip_render) evaluate_run(run, iteration, border, arguments.decompose);
        rows.push_back(read_table_row(run, iteration));
    }
    const auto other =
        std::find_if(rows.begin(), rows.end(), [&](const TableRow& row) { return row.ssim_protocol != rows[0].ssim_protocol; });
    if (other != rows.end())
        spdlog::warn("the SSIM of {} and {} were computed differently and do not compare (protocol in results.json)", rows[0].run,
                     other->run);
    std::fputs(format_table(rows, format).c_str(), stdout);
}

}  // namespace

void add_eval_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<EvalArguments>();
    CLI::App* command = app.add_subcommand("eval", "Render and score the test views of finished runs; print one table over all of them");
    command->add_option("runs", arguments->runs, "Run folders")->required()->type_name("RUN");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to evaluate (default: the last)")
        ->check(CLI::NonNegativeNumber);
    command->add_option("--format", arguments->format, "Table as markdown, csv or latex")->capture_default_str();
    command->add_option("--ssim-border", arguments->ssim_border, "SSIM at the image border: valid, reflect or zero (3DGS)")
        ->capture_default_str();
    CLI::Option* skip = command->add_flag("--skip-render", arguments->skip_render, "Only print the table of results that are already stored");
    command->add_flag("--decompose", arguments->decompose, "Also write base and residual of each test view, and the residual's mean")
        ->excludes(skip);
    command->callback([arguments, &selected] { selected = [arguments] { run_eval(*arguments); }; });
}

}  // namespace gs
