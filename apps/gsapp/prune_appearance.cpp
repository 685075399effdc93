// SPDX-License-Identifier: Apache-2.0
// gsapp prune-appearance: a run whose Gaussians keep view-dependent parameters only where these show.
#include "eval/runs/prune_appearance.h"

#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/gsapp/command.h"
#include "eval/runs/saved_run.h"
#include "kernels/core/error.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/io/atomic_file.h"
#include "lib/model/ply.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

struct PruneArguments {
    std::string run, output;
    std::int64_t iteration = -1;  ///< -1 = the last saved one
};

/// RUN-pruned, also where RUN ends with a slash.
fs::path default_output(const fs::path& run) { return (run.has_filename() ? run : run.parent_path()).string() + "-pruned"; }

/// A folder like the run's: the pruned model, and what opening it needs.
void write_run(const SavedRun& run, const Gaussians& pruned, const fs::path& output) {
    const RunFolder from{run.folder}, to{output};
    write_ply(to.point_cloud(run.iteration), pruned, {.iteration = run.iteration});
    TrainOptions options = run.options;
    options.model = output.string();
    write_text_atomic(to.config(), options_to_yaml(options));
    write_cfg_args(to, options);
    for (const auto file : {&RunFolder::cameras, &RunFolder::input_points, &RunFolder::ppisp, &RunFolder::appearance_choice})
        if (fs::exists((from.*file)())) fs::copy_file((from.*file)(), (to.*file)());
}

void run_prune(const PruneArguments& arguments) {
    const fs::path output = arguments.output.empty() ? default_output(arguments.run) : fs::path(arguments.output);
    if (fs::exists(output) && !fs::is_empty(output)) throw UsageError(fmt::format("{} is not empty; choose another folder with -o", output.string()));
    SavedRun run = open_saved_run(arguments.run, arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration));
    Gaussians model = run.backend->download(false);
    std::vector<CameraParams<float>> cameras;
    for (const View& view : run.scene.train) cameras.push_back(camera_params(view.camera));
    const std::int64_t pruned = prune_residuals(model, cameras);
    const double share = double(pruned) / double(std::max<std::int64_t>(1, model.count));
    const std::int64_t saved = pruned * model[Group::kResidual].width * std::int64_t(sizeof(float));
    std::string report = fmt::format("{} of {} Gaussians ({:.1f} %) show no view dependence in {} training views; {} bytes need not be stored\n",
                                     pruned, model.count, 100 * share, cameras.size(), saved);
    nlohmann::ordered_json json = {{"run", arguments.run},          {"iteration", run.iteration}, {"num_gaussians", model.count},
                                   {"pruned", pruned},              {"share", share},             {"bytes_saved", saved}};
    if (run.scene.test.empty()) {
        report += fmt::format("there are no test views to compare on ({})\n", run.scene.split_rule);
    } else {
        EvalOptions options;
        options.correction = run.correction;
        const EvalResult before = evaluate_views(*run.backend, run.scene.test, run.background, options);
        run.backend->upload(model);
        const EvalResult after = evaluate_views(*run.backend, run.scene.test, run.background, options);
        report += fmt::format("test views: PSNR {:.3f} before, {:.3f} after; SSIM {:.5f} before, {:.5f} after\n",
                              before.psnr, after.psnr, before.ssim, after.ssim);
        json["before"] = {{"PSNR", before.psnr}, {"SSIM", before.ssim}}, json["after"] = {{"PSNR", after.psnr}, {"SSIM", after.ssim}};
    }
    write_run(run, model, output);
    write_text_atomic(output / "pruned.json", json.dump(1) + "\n");
    std::fputs(report.c_str(), stdout);
    log_info("the pruned run: {}", output.string());
}

}  // namespace

void add_prune_appearance_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<PruneArguments>();
    CLI::App* command = app.add_subcommand("prune-appearance",
                                           "Take the view-dependent parameters from Gaussians of a finished run where they do not show");
    command->add_option("run", arguments->run, "Run folder")->required()->type_name("RUN");
    command->add_option("-o,--output", arguments->output, "Folder of the pruned run (default: RUN-pruned)")->type_name("FOLDER");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to prune (default: the last)")->check(CLI::NonNegativeNumber);
    command->callback([arguments, &selected] { selected = [arguments] { run_prune(*arguments); }; });
}

}  // namespace gs
