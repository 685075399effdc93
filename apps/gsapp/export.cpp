// SPDX-License-Identifier: Apache-2.0
// gsapp export: exports a finished run or a point cloud as a web page, or as a file for other programs.
#include <fmt/format.h>

#include <cctype>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/gsapp/arguments.h"
#include "apps/gsapp/command.h"
#include "apps/gsapp/export/export_run.h"
#include "apps/gsapp/printing.h"
#include "kernels/base/error.h"

namespace gs {
namespace {

struct ExportArguments {
    std::vector<std::string> runs;
    std::string output, up, format = "web", title, start_view, url;
    std::shared_ptr<SceneArguments> scene;
    std::int64_t iteration = -1;  ///< -1 = the last saved iteration
    int photographs = 0;          ///< maximum number of photographs
    bool has_format = false, sh_projection = false, overwrite = false, compatible = false, levels = false, json = false;
};

nlohmann::ordered_json json_of(const std::vector<ExportedModel>& exported) {
    nlohmann::ordered_json json;
    for (const ExportedModel& model : exported) {
        nlohmann::ordered_json& one = json["models"].emplace_back();
        one = {{"file", model.file.string()},
               {"bytes", std::filesystem::file_size(model.file)},
               {"num_gaussians", model.num_gaussians}};
        one["psnr"] = model.loss ? nlohmann::ordered_json(model.loss->psnr) : nlohmann::ordered_json();
        one["packed_psnr"] = model.loss ? nlohmann::ordered_json(model.loss->packed_psnr) : nlohmann::ordered_json();
    }
    return json;
}

/// Returns the format of the extension of --output, or an empty string if --output is a folder. Throws UsageError for
/// extensions of files that gsapp does not write.
std::string format_of_name(const std::filesystem::path& output) {
    std::error_code ignored;
    if (std::filesystem::is_directory(output, ignored)) return {};
    std::string ending = output.extension().string();
    for (char& c : ending) c = char(std::tolower(static_cast<unsigned char>(c)));
    if (ending == ".ply" || ending == ".splat") return ending.substr(1);
    const std::filesystem::path ply = std::filesystem::path(output).replace_extension(".ply");
    for (const char* converted : {".spz", ".sog", ".glb", ".html"})
        if (ending == converted)
            throw UsageError(
                fmt::format("--output {}: {} files are not written; write a .ply with -o {} and convert it: npx "
                            "@playcanvas/splat-transform {} {}{}",
                            output.string(), ending, ply.string(), ply.string(), output.string(),
                            ending == std::string(".html") ? "; or name a folder, which becomes a page" : ""));
    for (const char* other : {".ksplat", ".gltf", ".usdz", ".usd", ".obj", ".pth", ".pt", ".ckpt", ".npz", ".zip",
                              ".lcc", ".sogs", ".json"})
        if (ending == other)
            throw UsageError(
                fmt::format("--output {}: {} files are not written; -o {} writes a .ply, which most "
                            "programs read, and a folder becomes a page",
                            output.string(), ending, ply.string()));
    if (ending == ".ngsplat")
        throw UsageError(fmt::format("--output {}: name a folder, in which scene.ngsplat and its page are written",
                                     output.string()));
    return {};
}

void run_export(ExportArguments arguments) {
    const std::string named = format_of_name(arguments.output);
    if (!named.empty() && arguments.has_format && arguments.format != named)
        throw UsageError(fmt::format("--output {} names a .{} file, but --format {} writes {}", arguments.output, named,
                                     arguments.format,
                                     arguments.format == "web" ? "a folder" : "a ." + arguments.format));
    if (!named.empty()) arguments.format = named;
    if (arguments.sh_projection && arguments.format != "ply") throw UsageError("--sh-projection is for --format ply");
    RunChanges changes = arguments.scene->changes(arguments.runs);
    changes.needs_scene = arguments.photographs != 0 || arguments.levels;
    if (!changes.source.empty() && arguments.format != "web" && arguments.up.empty())
        throw UsageError("--source is for --format web, which measures on its views, and for --up");
    if (arguments.compatible && arguments.format != "web") throw UsageError("--compatible is for --format web");
    if (arguments.levels && arguments.format != "web")
        throw UsageError("--lod is for --format web, whose page chooses among the levels");
    if (arguments.photographs != 0 && arguments.format != "web")
        throw UsageError("--photographs is for --format web, whose page compares them with the model");
    for (const auto& [name, text] :
         {std::pair("--title", &arguments.title), {"--start-view", &arguments.start_view}, {"--url", &arguments.url}})
        if (!text->empty() && arguments.format != "web")
            throw UsageError(fmt::format("{} is for --format web, whose page it describes", name));
    if (arguments.photographs < 0) throw UsageError(fmt::format("--photographs={} is below 0", arguments.photographs));
    if (arguments.runs.size() > 1 && arguments.format != "web")
        throw UsageError("two runs are for --format web, whose page compares them");
    const ExportRequest request{
        .run = arguments.runs.front(),
        .iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration),
        .output = arguments.output,
        .is_file = !named.empty(),
        .overwrite = arguments.overwrite,
        .up = arguments.up,
        .compatible = arguments.compatible,
        .changes = changes};
    std::vector<ExportedModel> exported;
    if (arguments.format == "web")
        exported = export_web(request, {.second_run = arguments.runs.size() > 1 ? arguments.runs[1] : "",
                                        .levels = arguments.levels,
                                        .photographs = arguments.photographs,
                                        .title = arguments.title,
                                        .start_view = arguments.start_view,
                                        .url = arguments.url});
    else
        exported = {export_file(request, arguments.format == "ply" ? SplatFormat::kPly : SplatFormat::kSplat,
                                arguments.sh_projection)};
    if (arguments.json) print_json(json_of(exported));
}

}  // namespace

void add_export_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<ExportArguments>();
    CLI::App* command =
        app.add_subcommand("export", "Write a finished run or a .ply file as a web page, or for other programs");
    command
        ->add_option("runs", arguments->runs,
                     "Run folder or .ply file; with web also a second one of the same scene, which the page compares "
                     "with the first")
        ->required()
        ->expected(1, 2)
        ->type_name("RUN|FILE.ply");
    command->add_option("-o,--output", arguments->output, "Folder to write to, or a file NAME.ply or NAME.splat")
        ->required()
        ->type_name("DIR");
    command
        ->add_option("--format", arguments->format,
                     "web: a packed scene and the viewer; ply: the file that 3DGS writes; splat: one colour a "
                     "Gaussian, 32 bytes")
        ->capture_default_str()
        ->check(CLI::Validator(
            [](const std::string& word) {
                if (word == "web" || word == "ply" || word == "splat") return std::string();
                return "'" + word +
                       "' is none of web, ply and splat; npx @playcanvas/splat-transform makes .spz, .sog " +
                       "and others of a .ply";
            },
            "{web,ply,splat}"))
        ->each([arguments = arguments.get()](const std::string&) { arguments->has_format = true; });
    command->add_flag(
        "--sh-projection", arguments->sh_projection,
        "With ply: write the colours of any appearance as spherical harmonics of degree 3, fitted by least squares");
    command
        ->add_option("--up", arguments->up,
                     "Turn the model so that this axis points up, as the cameras were held: y, z or -y (default: as it "
                     "is; for colours of one direction and spherical harmonics)")
        ->check(CLI::IsMember({"y", "z", "-y"}));
    const CLI::Validator not_blank(
        [](const std::string& text) {
            return text.find_first_not_of(" \t\r\n") == std::string::npos ? "it is empty" : "";
        },
        "");
    command->add_option("--title", arguments->title, "With web: title of the page (default: the scene's name)")
        ->check(not_blank)
        ->type_name("TEXT");
    command
        ->add_option("--start-view", arguments->start_view,
                     "With web: what the page begins with: the name of a photograph, the number of a view in the "
                     "page's list, or a link that the page copied (default: the first view)")
        ->check(not_blank)
        ->type_name("VIEW");
    command
        ->add_option("--url", arguments->url,
                     "With web: address that the folder will have, for services that show a picture beside a link and "
                     "need its full address")
        ->check(not_blank)
        ->type_name("URL");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to export (default: the last)")
        ->check(CLI::NonNegativeNumber);
    command->add_flag("--photographs{40}", arguments->photographs,
                      "With web: also write the photographs of the test views as PNG, to compare with; of 40 evenly "
                      "spread views, or as many as --photographs=N says");
    command->add_flag("--lod", arguments->levels,
                      "With web: also write coarser levels, of a half to a sixteenth of the Gaussians, for phones and "
                      "slow devices; of two runs those of the first");
    command->add_flag("--compatible", arguments->compatible,
                      "With web: store a residual for every Gaussian, as the paper's viewer expects it, even if only "
                      "some have one");
    command->add_flag("--overwrite", arguments->overwrite, "Replace an earlier export in DIR");
    add_outcome_flag(*command, arguments->json);
    add_quiet_flag(*command);
    arguments->scene = std::make_shared<SceneArguments>(*command,
                                                        "With web: the scene, if a run's was moved since the training, "
                                                        "or to measure what packing a .ply file loses and "
                                                        "to show its test views; with --up: the scene of a .ply file",
                                                        DeviceOption::kDeclared);
    command->callback([arguments, &selected] { selected = [arguments] { run_export(*arguments); }; });
}

}  // namespace gs
