// SPDX-License-Identifier: Apache-2.0
// gsapp export: a finished run as a page that shows it, or as a file for other programs.
#include <memory>

#include "apps/gsapp/command.h"
#include "eval/runs/export_run.h"
#include "kernels/core/error.h"

namespace gs {
namespace {

struct ExportArguments {
    std::string run, output, source, format = "web";
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    bool sh_projection = false, overwrite = false, compatible = false;
};

void run_export(const ExportArguments& arguments) {
    if (arguments.sh_projection && arguments.format != "ply") throw UsageError("--sh-projection is for --format ply");
    if (!arguments.source.empty() && arguments.format != "web")
        throw UsageError("--source is for --format web, which measures on its views");
    if (arguments.compatible && arguments.format != "web") throw UsageError("--compatible is for --format web");
    const ExportRequest request{
        .run = arguments.run,
        .iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration),
        .output = arguments.output,
        .overwrite = arguments.overwrite,
        .compatible = arguments.compatible};
    if (arguments.format == "web")
        export_web(request, arguments.source);
    else
        export_file(request, arguments.format == "ply" ? SplatFormat::kPly : SplatFormat::kSplat,
                    arguments.sh_projection);
}

}  // namespace

void add_export_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<ExportArguments>();
    CLI::App* command =
        app.add_subcommand("export", "Write a finished run as a web page, or as a file for other programs");
    command->add_option("run", arguments->run, "Run folder")->required()->type_name("RUN");
    command->add_option("-o,--output", arguments->output, "Folder to write to")->required()->type_name("DIR");
    command
        ->add_option("--format", arguments->format,
                     "web: a packed scene and the viewer; ply: the file that 3DGS writes; splat: one colour a "
                     "Gaussian, 32 bytes")
        ->capture_default_str()
        ->check(CLI::IsMember({"web", "ply", "splat"}));
    command->add_flag(
        "--sh-projection", arguments->sh_projection,
        "With ply: write the colours of any appearance as spherical harmonics of degree 3, fitted by least squares");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to export (default: the last)")
        ->check(CLI::NonNegativeNumber);
    command->add_option("--source", arguments->source, "With web: the scene, if it was moved since the training")
        ->type_name("SCENE");
    command->add_flag(
        "--compatible", arguments->compatible,
        "With web: store a residual for every Gaussian, as the paper's viewer expects it, also where only "
        "some have one");
    command->add_flag("--overwrite", arguments->overwrite, "Replace an earlier export in DIR");
    command->callback([arguments, &selected] { selected = [arguments] { run_export(*arguments); }; });
}

}  // namespace gs
