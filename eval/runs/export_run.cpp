// SPDX-License-Identifier: Apache-2.0
// Packs a run for the web viewer, or converts it for other programs.
#include "eval/runs/export_run.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "appearance/model_info.h"
#include "eval/runs/packing_loss.h"
#include "eval/runs/saved_run.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/version.h"
#include "lib/export/pack_scene.h"
#include "lib/export/sh_projection.h"
#include "lib/export/site.h"
#include "lib/export/splat_file.h"
#include "lib/model/ply.h"
#include "lib/scene/frame.h"
#include "lib/train/scene_options.h"

namespace gs {
namespace {

/// Returns what the file says about itself, where other readers do not look.
std::string trailer(const SavedRun& run, const Gaussians& model, const PackedScene& scene,
                    const std::optional<PackingLoss>& loss) {
    nlohmann::ordered_json json = {{"generator", version_text()},
                                   {"scene", scene_name(run.options.source)},
                                   {"appearance", model.appearance.model},
                                   {"iteration", run.iteration},
                                   {"background", {run.background.x, run.background.y, run.background.z}},
                                   {"num_gaussians", scene.count()},
                                   {"bytes_per_gaussian", scene.mean_bytes_per_gaussian()},
                                   {"photometric", correction_name(run.correction.mode)}};
    if (!run.scene.frame.is_identity()) json["frame"] = frame_json(run.scene.frame);
    if (loss)
        json["test_views"] = {{"psnr", loss->psnr},
                              {"packed_psnr", loss->packed_psnr},
                              {"protocol", protocol_line(protocols().front(), run.background)}};
    return json_text(json);
}

/// Whether programs that know spherical harmonics alone show these colours as they are.
bool is_plain_sh(const Gaussians& g) {
    return appearance_model(g.appearance.model).plain_sh && g.appearance.activation == ColorActivation::kRelu;
}

}  // namespace

void export_web(const ExportRequest& request, const std::string& source) {
    const std::filesystem::path folder = request.output, viewer = viewer_folder();
    require_free(folder, {"scene.ngsplat", "index.html"}, request.overwrite);
    SavedRun run = open_saved_run(request.run, request.iteration, {.source = source});
    const Gaussians all = run.backend->download(false);
    require_finite(all);
    Gaussians model = visible_gaussians(all);
    if (request.compatible) complete_residuals(model);
    order_by_importance(model);
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

    log_info("{}: {} Gaussians, {:.4g} bytes each ({} of them geometry and base colour)",
             (folder / "scene.ngsplat").string(), scene.count(), scene.mean_bytes_per_gaussian(),
             sizeof(GeometryWords));
    if (scene.is_mixed())
        log_info(
            "the colour of {} of them depends on the view; --compatible writes the others the same, for viewers "
            "that know no mixed models",
            scene.appearance.rows);
    if (loss)
        log_info("PSNR of the {} test views {:.3f} dB, packed {:.3f} dB: {:.3f} dB lost", run.scene.test.size(),
                 loss->psnr, loss->packed_psnr, loss->psnr - loss->packed_psnr);
    else
        log_info("the run has no test views (--eval): what packing loses was not measured");
    if (viewer.empty())
        log_warning("the web viewer is not built, so that only the scene was written; scripts/build-viewer builds it");
    else
        log_info("show it with: gsapp view {}", folder.string());
}

void export_file(const ExportRequest& request, SplatFormat format, bool sh_projection) {
    const char* name = format == SplatFormat::kPly ? "point_cloud.ply" : "point_cloud.splat";
    require_free(request.output, {name}, request.overwrite);
    const std::filesystem::path path = request.output / name;
    SavedModel saved = read_saved_model(request.run, request.iteration);
    const Frame frame = saved.frame.value_or(Frame{});
    require_finite(saved.state);
    saved.state = visible_gaussians(saved.state);
    if (saved.state.ppisp.active())
        log_warning("the file cannot hold the photometric correction: colours are those before it");
    if (format == SplatFormat::kSplat) {
        const ShProjection mean = project_to_sh(saved.state, 0);
        write_splat(path, mean.gaussians, frame);
        if (const Eigen::Vector3d offset = file_offset(frame); !offset.isZero(0))
            log_warning("{}: positions lack the offset ({}, {}, {}), for which its floats are too coarse",
                        path.string(), offset.x(), offset.y(), offset.z());
        log_info("{}: {} Gaussians in their mean colour, {:.2f} dB to their colours over all directions", path.string(),
                 saved.state.count, mean.psnr);
        return;
    }
    PlyOptions options{.iteration = saved.iteration, .frame = frame};
    if (sh_projection && !is_plain_sh(saved.state)) {
        ShProjection projection = project_to_sh(saved.state, 3);
        options.note = fmt::format("spherical harmonics fitted to the colours of {}, {:.2f} dB over all directions",
                                   saved.state.appearance.model, projection.psnr);
        log_info("{}", options.note);
        saved.state = std::move(projection.gaussians);
    }
    write_ply(path, saved.state, options);
    log_info("{}: {} Gaussians", path.string(), saved.state.count);
    if (!is_plain_sh(saved.state))
        log_info(
            "other programs show its base colours; --sh-projection fits spherical harmonics, which show view "
            "dependence");
}

}  // namespace gs
