// SPDX-License-Identifier: Apache-2.0
// gsapp export: a finished run as a page that shows it, or as a file for other programs.
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "appearance/model_info.h"
#include "apps/gsapp/command.h"
#include "eval/runs/packing_loss.h"
#include "eval/runs/saved_run.h"
#include "kernels/core/error.h"
#include "lib/core/log.h"
#include "lib/core/version.h"
#include "lib/export/pack_scene.h"
#include "lib/export/sh_projection.h"
#include "lib/export/site.h"
#include "lib/export/splat_file.h"
#include "lib/model/ply.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

struct ExportArguments {
    std::string run, output, source, format = "web";
    std::int64_t iteration = -1;  ///< -1 = the last saved one
    bool sh_projection = false, overwrite = false;
};

/// What the file says about itself where other readers do not look.
std::string trailer(const SavedRun& run, const Gaussians& model, const PackedScene& scene, const std::optional<PackingLoss>& loss) {
    nlohmann::ordered_json json = {{"generator", version_text()},
                                   {"scene", scene_name(run.options.source)},
                                   {"appearance", model.appearance.model},
                                   {"iteration", run.iteration},
                                   {"background", {run.background.x, run.background.y, run.background.z}},
                                   {"num_gaussians", scene.count()},
                                   {"bytes_per_gaussian", scene.bytes_per_gaussian()},
                                   {"photometric", correction_name(run.correction.mode)}};
    if (loss) json["test_views"] = {{"psnr", loss->psnr}, {"packed_psnr", loss->packed_psnr}, {"protocol", protocol_line(protocols().front(), run.background)}};
    return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

void export_web(const ExportArguments& arguments, std::optional<std::int64_t> iteration) {
    const std::filesystem::path folder = arguments.output, viewer = viewer_folder();
    require_free(folder, {"scene.ngsplat", "index.html"}, arguments.overwrite);
    SavedRun run = open_saved_run(arguments.run, iteration, {.source = arguments.source});
    const Gaussians all = run.backend->download(false);
    require_finite(all);
    const Gaussians model = visible_gaussians(all);
    PackedScene scene = pack_gaussians(model);
    add_cameras(scene, model, run.scene.test);
    if (all.ppisp.active()) scene.ppisp = packed_correction(run);
    std::optional<PackingLoss> loss;
    if (!run.scene.test.empty()) loss = packing_loss(run, scene);
    scene.trailer = trailer(run, model, scene, loss);

    Staging staging(folder);
    write_ngsplat(staging.path() / "scene.ngsplat", scene);
    if (!viewer.empty()) copy_folder(viewer, staging.path());
    staging.publish();
    if (!viewer.empty()) remove_other_versions(viewer, folder);

    log_info("{}: {} Gaussians, {} bytes each ({} of them geometry and base colour)", (folder / "scene.ngsplat").string(), scene.count(),
                 scene.bytes_per_gaussian(), sizeof(GeometryWords));
    if (loss)
        log_info("PSNR of the {} test views {:.3f} dB, packed {:.3f} dB: {:.3f} dB lost", run.scene.test.size(), loss->psnr, loss->packed_psnr,
                     loss->psnr - loss->packed_psnr);
    else
        log_info("the run has no test views (--eval): what packing loses was not measured");
    if (viewer.empty())
        log_warning("the web viewer is not built, so that only the scene was written; scripts/build-viewer builds it");
    else
        log_info("show it with: gsapp view {}", folder.string());
}

/// For programs that know one kind of Gaussian: whether spherical harmonics say it already.
bool is_plain_sh(const Gaussians& g) {
    return appearance_model(g.appearance.model).plain_sh && g.appearance.activation == ColorActivation::kRelu;
}

void export_file(const ExportArguments& arguments, std::optional<std::int64_t> iteration) {
    const std::string name = "point_cloud." + arguments.format;
    require_free(arguments.output, {name}, arguments.overwrite);
    const std::filesystem::path path = std::filesystem::path(arguments.output) / name;
    SavedModel saved = read_saved_model(arguments.run, iteration);
    require_finite(saved.state);
    saved.state = visible_gaussians(saved.state);
    if (saved.state.ppisp.active()) log_warning("the file cannot hold the photometric correction: colours are those before it");
    if (arguments.format == "splat") {
        const ShProjection mean = project_to_sh(saved.state, 0);
        write_splat(path, mean.gaussians);
        log_info("{}: {} Gaussians in their mean colour, {:.2f} dB to their colours over all directions", path.string(), saved.state.count, mean.psnr);
        return;
    }
    PlyOptions options{saved.iteration};
    if (arguments.sh_projection && !is_plain_sh(saved.state)) {
        ShProjection projection = project_to_sh(saved.state, 3);
        options.note = fmt::format("spherical harmonics fitted to the colours of {}, {:.2f} dB over all directions", saved.state.appearance.model,
                                   projection.psnr);
        log_info("{}", options.note);
        saved.state = std::move(projection.gaussians);
    }
    write_ply(path, saved.state, options);
    log_info("{}: {} Gaussians", path.string(), saved.state.count);
    if (!is_plain_sh(saved.state)) log_info("other programs show its base colours; --sh-projection fits spherical harmonics, which show view dependence");
}

void run_export(const ExportArguments& arguments) {
    if (arguments.sh_projection && arguments.format != "ply") throw UsageError("--sh-projection is for --format ply");
    if (!arguments.source.empty() && arguments.format != "web") throw UsageError("--source is for --format web, which measures on its views");
    const auto iteration = arguments.iteration < 0 ? std::nullopt : std::optional(arguments.iteration);
    arguments.format == "web" ? export_web(arguments, iteration) : export_file(arguments, iteration);
}

}  // namespace

void add_export_command(CLI::App& app, Command& selected) {
    auto arguments = std::make_shared<ExportArguments>();
    CLI::App* command = app.add_subcommand("export", "Write a finished run as a web page, or as a file for other programs");
    command->add_option("run", arguments->run, "Run folder")->required()->type_name("RUN");
    command->add_option("-o,--output", arguments->output, "Folder to write to")->required()->type_name("DIR");
    command->add_option("--format", arguments->format, "web: packed scene and viewer; ply: as 3DGS writes it; splat: one colour a Gaussian, 32 bytes")
        ->capture_default_str()
        ->check(CLI::IsMember({"web", "ply", "splat"}));
    command->add_flag("--sh-projection", arguments->sh_projection, "With ply: colours of any appearance as spherical harmonics of degree 3, least squares");
    command->add_option("--iteration", arguments->iteration, "Saved iteration to export (default: the last)")->check(CLI::NonNegativeNumber);
    command->add_option("--source", arguments->source, "With web: the scene, where it is no longer where it was for training")->type_name("SCENE");
    command->add_flag("--overwrite", arguments->overwrite, "Replace an earlier export in DIR");
    command->callback([arguments, &selected] { selected = [arguments] { run_export(*arguments); }; });
}

}  // namespace gs
