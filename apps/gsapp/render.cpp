// SPDX-License-Identifier: Apache-2.0
// gsapp render: pictures of a finished run from its own cameras, a file of cameras, or an orbit.
#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/runs/appearance_colors.h"
#include "eval/runs/camera_path.h"
#include "eval/runs/render_views.h"
#include "kernels/core/error.h"
#include "lib/core/log.h"

namespace gs {
namespace {

struct RenderArguments {
    std::string run, views = "test", path, output, ppisp_eval, show = "picture";
    int orbit = 0;
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    bool decompose = false;
};

std::vector<View> wanted_views(const RenderArguments& arguments, const Scene& scene) {
    if (!arguments.path.empty()) return views_of(read_camera_path(arguments.path, scene.frame));
    if (arguments.orbit > 0) return views_of(orbit_path(scene.train, arguments.orbit));
    std::vector<View> views = views_of(scene, arguments.views);
    if (views.empty())
        throw UsageError(
            fmt::format("{} has no {} views; --eval holds some out when training", arguments.run, arguments.views));
    return views;
}

void run_render(const RenderArguments& arguments) {
    SavedRun run =
        open_saved_run(arguments.run, arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration));
    const std::vector<View> views = wanted_views(arguments, run.scene);
    EvalCorrection correction = run.correction;
    correction.mode = choose_correction(arguments.ppisp_eval, run.correction.mode);
    if (arguments.show == "appearance") {
        if (arguments.decompose) throw UsageError("--show appearance has one colour a Gaussian; it has no --decompose");
        run.backend->upload(appearance_colors(run.backend->download(false), run.scene.train));
        run.background = {0, 0, 0};
    }
    const std::filesystem::path folder = arguments.output.empty()
                                             ? run.folder / "renders" / fmt::format("iteration_{}", run.iteration)
                                             : std::filesystem::path(arguments.output);
    render_views(run, views, correction, arguments.decompose, folder);
    const char* what = arguments.decompose ? "pictures, each with base and residual," : "pictures";
    log_info("{} {} in {}", views.size(), what, folder.string());
}

}  // namespace

void add_render_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<RenderArguments>();
    CLI::App* command = app.add_subcommand("render", "Write pictures of a finished run");
    command->add_option("run", arguments->run, "Run folder")->required()->type_name("RUN");
    command
        ->add_option("--ppisp-eval", arguments->ppisp_eval,
                     "Photometric correction: controller (default where the model has one), or none = neutral exposure "
                     "and colour")
        ->check(CLI::IsMember({"controller", "none"}));
    CLI::Option* views = command->add_option("--views", arguments->views, "Cameras of the scene: test, train or all")
                             ->capture_default_str();
    views->check(CLI::IsMember({"test", "train", "all"}));
    CLI::Option* path =
        command->add_option("--path", arguments->path, "File of cameras in the cameras.json format")->excludes(views);
    command->add_option("--orbit", arguments->orbit, "That many cameras on a circle around the scene")
        ->check(CLI::Range(1, 1000000))
        ->excludes(views)
        ->excludes(path);
    command->add_option("--iteration", arguments->iteration, "Saved iteration to render (default: the last)")
        ->check(CLI::NonNegativeNumber);
    command->add_option("-o,--output", arguments->output, "Folder for the pictures (default: RUN/renders/iteration_N)");
    command->add_flag(
        "--decompose", arguments->decompose,
        "Also write the base colour without view dependence, and the residual: OUTPUT/{full,base,residual}");
    command
        ->add_option("--show", arguments->show,
                     "picture; or appearance: grey where a Gaussian has one colour from everywhere, else from blue to "
                     "yellow by how much its colour depends on the view")
        ->capture_default_str()
        ->check(CLI::IsMember({"picture", "appearance"}));
    command->callback([arguments, &selected] { selected = [arguments] { run_render(*arguments); }; });
}

}  // namespace gs
