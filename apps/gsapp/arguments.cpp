// SPDX-License-Identifier: Apache-2.0
// Starts the ranks of a command, and parses the scene options of a point cloud.
#include "apps/gsapp/arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/options.h"

namespace gs {
namespace {

/// Options that also apply to a run.
const std::set<std::string> kOfRuns = {"source", "device", "lens"};

std::vector<std::string> keys(const CLI::App& command, DeviceOption device) {
    std::vector<std::string> all = {"source",    "images",    "resolution",   "eval",       "test-every",
                                    "test-list", "mask-mode", "invert-masks", "alpha-mode", "background"};
    if (device == DeviceOption::kDeclared) all.push_back("device");
    if (!command.get_option_no_throw("--lens")) all.push_back("lens");  // render has one of its own
    return all;
}

}  // namespace

CLI::Option* add_ranks_option(CLI::App& command, int& ranks) {
    return command
        .add_option("--ranks", ranks,
                    "Processes of this machine that share the Gaussians and render views at the same time, each with "
                    "a GPU of its own if the device is a GPU (docs/ranks.md)")
        ->check(CLI::Range(1, 4096));
}

std::unique_ptr<RankGroup> join_ranks(int ranks, const std::string& command, const std::string& subject, int threads) {
    if (ranks == 1) return nullptr;
    auto group = RankGroup::join(ranks, command + " " + subject);
    set_num_threads(threads_of_rank(*group, threads));
    if (group->rank() == 0) group->agree(started_as(command));
    return group;
}

SceneArguments::SceneArguments(CLI::App& command, const std::string& source_help, DeviceOption device)
    : arguments_(command, keys(command, device), "Views of a .ply file") {
    command.get_option("--source")->description(source_help)->type_name("SCENE")->group("Options");
    command.get_option("--eval")->description("Hold out test views (default); --eval=false: all views train");
    if (device == DeviceOption::kDeclared)
        command.get_option("--device")
            ->description("Where it is rendered: auto, cpu or cuda (default: as the run was trained; auto)")
            ->group("Options");
}

RunChanges SceneArguments::changes(const std::vector<std::string>& runs) const {
    TrainOptions options;
    options.eval = true;
    arguments_.apply(options);
    const std::set<std::string> given = arguments_.given();
    RunChanges changes{.source = options.source, .point_cloud = options};
    if (given.contains("device")) changes.device = options.device;
    if (given.contains("lens")) changes.lens = options.lens;
    if (std::any_of(runs.begin(), runs.end(), [](const std::string& run) { return is_point_cloud(run); }))
        return changes;
    for (const Option& option : train_option_table()) {
        if (!given.contains(option.key) || kOfRuns.contains(option.key)) continue;
        const auto same = [&](const std::string& run) {
            return option_text(option, load_run_options(run)) == option_text(option, options);
        };
        if (!std::all_of(runs.begin(), runs.end(), same))
            throw UsageError(
                fmt::format("--{}: goes with a .ply file; a run is seen as its own options say", option.key));
    }
    return changes;
}

}  // namespace gs
