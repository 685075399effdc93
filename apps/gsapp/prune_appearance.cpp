// SPDX-License-Identifier: Apache-2.0
// gsapp prune-appearance: a run whose Gaussians keep view-dependent parameters only where these show.
#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>

#include "apps/gsapp/command.h"
#include "apps/gsapp/printing.h"
#include "eval/runs/prune_run.h"
#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct PruneArguments {
    std::string run, source, output;
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    bool json = false;
};

void run_prune(const PruneArguments& arguments) {
    const fs::path output = arguments.output.empty() ? pruned_folder(arguments.run) : fs::path(arguments.output);
    if (path_exists(output) && !list_folder(output).empty())
        throw UsageError(fmt::format("{} is not empty; choose another folder with -o", output.string()));
    SavedRun run =
        open_saved_run(arguments.run, arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration),
                       {.source = arguments.source});
    const PruneReport report = prune_run(run, output);
    if (arguments.json) {
        nlohmann::ordered_json json = prune_report_json(report);
        json["output"] = output.string();
        print_json(json);
    } else {
        std::fputs(format_prune_report(report).c_str(), stdout);
    }
    log_info("the pruned run: {}", output.string());
}

}  // namespace

void add_prune_appearance_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<PruneArguments>();
    CLI::App* command = app.add_subcommand(
        "prune-appearance", "Remove view-dependent parameters that do not show from the Gaussians of a finished run");
    command->add_option("run", arguments->run, "Run folder")->required()->type_name("RUN");
    command
        ->add_option("-s,--source", arguments->source,
                     "Scene of the run, if it is no longer where it was at the training")
        ->type_name("SCENE");
    command->add_option("-o,--output", arguments->output, "Folder of the pruned run (default: RUN-pruned)")
        ->type_name("FOLDER");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to prune (default: the last)")
        ->check(CLI::NonNegativeNumber);
    add_json_flag(*command, arguments->json);
    add_quiet_flag(*command);
    command->callback([arguments, &selected] { selected = [arguments] { run_prune(*arguments); }; });
}

}  // namespace gs
