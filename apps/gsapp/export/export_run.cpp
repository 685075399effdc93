// SPDX-License-Identifier: Apache-2.0
// Packs a run for the web viewer and scores the loss, or converts it for other programs.
#include "apps/gsapp/export/export_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>

#include "appearance/model_info.h"
#include "apps/gsapp/export/site_page.h"
#include "apps/gsapp/render/camera_path.h"
#include "apps/gsapp/render/orbit.h"
#include "eval/metrics/quantize.h"
#include "eval/runs/decompose.h"
#include "eval/runs/evaluate.h"
#include "eval/runs/shown_views.h"
#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/core/version.h"
#include "lib/export/coarser.h"
#include "lib/export/pack_scene.h"
#include "lib/export/packed_model.h"
#include "lib/export/sh_projection.h"
#include "lib/export/site.h"
#include "lib/export/splat_file.h"
#include "lib/export/turn.h"
#include "lib/io/atomic_file.h"
#include "lib/model/ply.h"
#include "lib/model/run_folder.h"
#include "lib/model/whole_model.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/frame.h"
#include "lib/scene/resized.h"
#include "lib/scene/scene.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// Returns the scene name of a run for a site.
std::string name_of(const SavedRun& run) {
    return run.options.source.empty() ? run.folder.stem().string() : scene_name(run.options.source);
}

/// Returns the JSON metadata of a file, stored after the last texture. `num_all`: number of Gaussians of the full model
/// if this is a coarser level of it; 0 otherwise.
std::string trailer(const SavedRun& run, const Gaussians& model, const PackedScene& scene,
                    const std::optional<PackingLoss>& loss, bool described, std::int64_t num_all) {
    nlohmann::ordered_json json = {{"generator", version_text()},
                                   {"scene", name_of(run)},
                                   {"appearance", model.appearance.model},
                                   {"iteration", run.iteration},
                                   {"background", {run.background.x, run.background.y, run.background.z}},
                                   {"num_gaussians", scene.count()},
                                   {"bytes_per_gaussian", scene.mean_bytes_per_gaussian()},
                                   {"photometric", correction_name(run.correction.mode)}};
    if (num_all > 0) json["level_of"] = num_all;
    if (run.scene.test.empty() && !scene.cameras.empty()) json["views"] = "training";
    if (!run.scene.frame.is_identity()) json["frame"] = frame_json(run.scene.frame);
    if (loss)
        json["test_views"] = {{"psnr", loss->psnr},
                              {"packed_psnr", loss->packed_psnr},
                              {"protocol", protocol_line(protocols().front(), run.background)}};
    if (described) json["site"] = true;
    return json_text(json);
}

/// Returns whether programs that support only spherical harmonics show these colours exactly.
bool is_plain_sh(const Gaussians& g) {
    return appearance_model(g.appearance.model).plain_sh && g.appearance.activation == ColorActivation::kRelu;
}

/// Returns the rotation of ExportRequest::up; `up` must not be empty.
Eigen::Matrix3d turn_of(const std::string& up, const std::vector<Camera>& cameras) {
    if (cameras.empty())
        throw UsageError("--up: no cameras say what is up in a point cloud without a run; name its --source SCENE");
    log_info("turned so that {} is up", up);
    const Eigen::Vector3d axis = up == "z" ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitY();
    return turn_to(up_direction(cameras), up == "-y" ? Eigen::Vector3d(-axis) : axis);
}

/// Rotates a run and its cameras.
void turn_run(SavedRun& run, const std::string& up) {
    std::vector<Camera> cameras;
    for (const auto* views : {&run.scene.test, &run.scene.train})
        for (const View& view : *views) cameras.push_back(view.camera);
    const Eigen::Matrix3d rotation = turn_of(up, cameras);
    Gaussians model = run.backend->download(false);
    turn(model, rotation);
    run.backend->upload(model);
    for (auto* views : {&run.scene.test, &run.scene.train})
        for (View& view : *views) view.camera = turned(view.camera, rotation);
    run.scene.frame.center = rotation * run.scene.frame.center;
}

/// One packed file of a run.
struct PackedLevel {
    PackedScene scene;
    std::optional<PackingLoss> loss;
};

/// A run packed for the viewer, and its metadata for site.json.
struct PackedRun {
    std::vector<PackedLevel> levels;  ///< the full model, then coarser levels
    std::vector<View> views;          ///< the test views, or some of the training views if there are none
    bool has_test_views = false;
    Vec3<float> background;
    std::string scene_name;
    std::string start;  ///< StartView::fragment
    Image preview;      ///< preview image of the page; without pixels if no page was requested
};

/// Finds the page's first view, and renders its preview.
void add_start(PackedRun& packed, SavedRun& run, const Gaussians& model, const std::string& start_view) {
    std::vector<Camera> cameras;
    for (const View& view : packed.views) cameras.push_back(view.camera);
    const NamedViews views{packed.views, run.scene, find_up(cameras).value_or(-Eigen::Vector3d::UnitY()),
                           median_center(model)};
    OrbitShape shape{.up = views.up};
    const View first = packed.views.empty() ? usual_view(model, shape, run.scene.frame) : packed.views.front();
    const StartView start = find_start_view(start_view, views, first);
    packed.start = start.fragment;
    const Camera camera = preview_camera(start.view.camera, kPreviewWidth, kPreviewHeight);
    RenderedImage image;
    run.backend->render(
        part_request(camera_params(camera), run.background, RenderMode::kFull, view_isp(start.view, run.correction)),
        image);
    packed.preview = quantized_render(image);
}

/// Packs a run and its levels. `described`: whether a site.json is written beside the file. `coarser`: whether to
/// create coarser levels. `begins`: whether the viewer's page starts with this run, and so needs its first view and its
/// preview.
PackedRun pack_run(const ExportRequest& request, const std::filesystem::path& folder, const SiteOptions& site,
                   bool described, bool coarser, bool begins) {
    SavedRun run = open_saved_run(folder, request.iteration, request.changes);
    const bool has_test_views = !run.scene.test.empty();
    if (site.photographs > 0 && !has_test_views)
        throw UsageError(
            fmt::format("{}: the run has no test views (--eval), whose photographs could be written", folder.string()));
    if (!request.up.empty()) turn_run(run, request.up);
    const Gaussians all = run.backend->download(false);
    require_finite(all);
    std::vector<CoarserModel> models = {{visible_gaussians(all), {}}};
    if (request.compatible) complete_residuals(models[0].gaussians);
    PackedRun packed{.levels = {},
                     .views = without_lenses(has_test_views ? run.scene.test : shown_views(run.scene)),
                     .has_test_views = has_test_views,
                     .background = run.background,
                     .scene_name = name_of(run),
                     .start = {},
                     .preview = {}};
    // Comes first, because --start-view may be refused.
    if (begins) add_start(packed, run, models[0].gaussians, site.start_view);
    std::optional<PackedPpisp> correction;
    if (all.ppisp.active()) correction = packed_correction(run, packed.views);
    // Uploads the model, whose views packing_loss() compares below.
    models[0].scores = view_scores(run, models[0].gaussians);
    if (coarser) {
        if (run.scene.train.empty() && !has_test_views)
            throw UsageError(
                fmt::format("{}: --lod measures on views what a Gaussian is worth, and there are none; "
                            "name the scene of a point cloud with --source",
                            folder.string()));
        std::vector<CoarserModel> levels = coarser_levels(models[0].gaussians, models[0].scores);
        std::move(levels.begin(), levels.end(), std::back_inserter(models));
    }
    for (auto& [model, scores] : models) {
        const bool is_whole = packed.levels.empty();
        order_by_importance(model, scores);
        PackedLevel level{pack_gaussians(model), std::nullopt};
        PackedScene& scene = level.scene;
        add_cameras(scene, models[0].gaussians, packed.views);  // the same for all levels
        scene.ppisp = correction;
        if (has_test_views && is_whole)
            level.loss = packing_loss(run, scene);
        else if (has_test_views)
            level.loss = PackingLoss{packed.levels[0].loss->psnr, packed_psnr(run, scene)};
        scene.trailer =
            trailer(run, model, scene, level.loss, described, is_whole ? 0 : packed.levels[0].scene.count());
        packed.levels.push_back(std::move(level));
    }
    return packed;
}

bool is_same_camera(const Camera& a, const Camera& b) {
    constexpr double kTolerance = 1e-5;
    const auto near = [](double x, double y) { return std::abs(x - y) <= kTolerance * std::abs(x); };
    return a.width == b.width && a.height == b.height && near(a.fx, b.fx) && near(a.fy, b.fy) && near(a.cx, b.cx) &&
           near(a.cy, b.cy) && (a.rotation - b.rotation).norm() <= kTolerance &&
           (a.translation - b.translation).norm() <= kTolerance * (1 + a.translation.norm());
}

/// Throws UsageError unless both runs have the same views: images of other scenes, sizes or splits are not comparable.
void require_same_views(const PackedRun& a, const PackedRun& b, const ExportRequest& request, const SiteOptions& site) {
    const std::string runs = fmt::format("{} and {} do not compare", request.run.string(), site.second_run.string());
    const char* kind = a.has_test_views ? "test" : "training";
    if (a.has_test_views != b.has_test_views || a.views.size() != b.views.size())
        throw UsageError(fmt::format("{}: {} {} and {} {} views; both must be runs of one scene, split alike", runs,
                                     a.views.size(), kind, b.views.size(), b.has_test_views ? "test" : "training"));
    for (std::size_t i = 0; i < a.views.size(); ++i) {
        if (!is_same_camera(a.views[i].camera, b.views[i].camera))
            throw UsageError(
                fmt::format("{}: their {} view {} has other cameras ('{}', '{}'); both must be runs of one "
                            "scene, split alike and of one size",
                            runs, kind, i + 1, a.views[i].name, b.views[i].name));
    }
}

void log_packed(const std::filesystem::path& file, const PackedRun& run) {
    const auto& [scene, loss] = run.levels[0];
    log_info("{}: {} Gaussians, {:.4g} bytes each ({} of them geometry and base colour)", file.string(), scene.count(),
             scene.mean_bytes_per_gaussian(), sizeof(GeometryWords));
    if (scene.is_mixed())
        log_info(
            "the colour of {} of them depends on the view; --compatible writes the others the same, for viewers "
            "that know no mixed models",
            scene.appearance.rows);
    if (loss)
        log_info("PSNR of the {} test views {:.3f} dB, packed {:.3f} dB: {:.3f} dB lost", run.views.size(), loss->psnr,
                 loss->packed_psnr, loss->psnr - loss->packed_psnr);
    else
        log_info("there are no test views (--eval): what packing loses was not measured");
}

void log_levels(const PackedRun& run) {
    if (run.levels.size() == 1)
        log_info(
            "no coarser levels: they make smaller files only of models with at least {1} Gaussians; this one has {0}",
            run.levels[0].scene.count(), 2 * ngsplat_unit());
    for (std::size_t k = 1; k < run.levels.size(); ++k) {
        const auto& [scene, loss] = run.levels[k];
        log_info("{}: {} Gaussians{}", site_file::level(k), scene.count(),
                 loss ? fmt::format(", {:.3f} dB", loss->packed_psnr) : "");
    }
}

/// Writes the levels of the first run, and returns their entries for site.json.
nlohmann::ordered_json write_levels(const std::filesystem::path& folder, const PackedRun& run) {
    nlohmann::ordered_json out = nlohmann::ordered_json::array();
    for (std::size_t k = 0; k < run.levels.size(); ++k) {
        const auto& [scene, loss] = run.levels[k];
        const std::string name = k == 0 ? site_file::kScene : site_file::level(k);
        if (k > 0) write_ngsplat(folder / name, scene);
        nlohmann::ordered_json level = {
            {"file", name}, {"num_gaussians", scene.count()}, {"bytes", std::filesystem::file_size(folder / name)}};
        if (loss) level["psnr"] = loss->packed_psnr;
        out.push_back(std::move(level));
    }
    return out;
}

/// Writes the photographs of at most `most` views. Returns their paths in the site, null for views without a
/// photograph.
nlohmann::ordered_json write_photographs(const std::filesystem::path& folder, const PackedRun& run, int most) {
    const std::size_t all = run.views.size(), count = std::min(all, std::size_t(most));
    nlohmann::ordered_json paths(all, nullptr);
    for (std::size_t k = 0; k < count; ++k) {
        const std::size_t view = k * all / count;
        paths[view] = site_file::photograph(view);
        write_image(folder / site_file::photograph(view), photograph_of(run.views[view], run.background));
    }
    log_info("photographs of {} of the {} test views{}", count, all, count < all ? "; --photographs=N writes N" : "");
    return paths;
}

/// Copies the viewer, whose page starts with the run, and writes the image of its first view.
void write_page(const std::filesystem::path& folder, const std::filesystem::path& viewer, const PackedRun& run,
                const SiteOptions& site) {
    copy_folder(viewer, folder);
    write_image(folder / site_file::kPreview, run.preview);
    const PageHead head{.title = site.title.empty() ? run.scene_name : site.title,
                        .description = fmt::format("A scene in 3D, of {} Gaussians: turn it, or fly through it.",
                                                   run.levels[0].scene.count()),
                        .own_title = !site.title.empty(),
                        .start = run.start,
                        .preview = site_file::kPreview,
                        .url = site.url.empty() ? "" : folder_url(site.url)};
    const std::filesystem::path page = folder / site_file::kPage;
    write_text_atomic(page, with_head(read_input(page), head));
}

/// Throws for options that cannot be applied, before any time is spent.
void require_page(const SiteOptions& site, bool has_viewer) {
    const bool is_asked = !site.title.empty() || !site.start_view.empty() || !site.url.empty();
    if (is_asked && !has_viewer)
        throw DataError(
            "--title, --start-view and --url are for the page, and the web viewer is not built; scripts/build-viewer "
            "builds it");
    if (!site.url.empty()) folder_url(site.url);
}

/// Returns the names of the runs on the page: the names of their folders, or the paths if these names are equal.
std::vector<std::string> run_names(const std::vector<std::filesystem::path>& folders) {
    std::vector<std::string> names;
    for (const auto& folder : folders) {
        const auto path = std::filesystem::absolute(folder).lexically_normal();
        names.push_back((path.has_filename() ? path : path.parent_path()).filename().string());
    }
    if (names.size() == 2 && names[0] == names[1])
        for (std::size_t i = 0; i < names.size(); ++i) names[i] = folders[i].generic_string();
    return names;
}

/// Returns the cameras that define the up direction: cameras.json of a run, or the scene of a point cloud.
std::vector<Camera> cameras_of(const ExportRequest& request) {
    if (!is_point_cloud(request.run)) return read_camera_path(RunFolder{request.run}.cameras(), Frame{}).cameras;
    std::vector<Camera> cameras;
    if (request.changes.source.empty()) return cameras;
    const Scene scene = load_scene(saved_options(request.run, request.changes));
    for (const auto* views : {&scene.test, &scene.train})
        for (const View& view : *views) cameras.push_back(view.camera);
    return cameras;
}

}  // namespace

double packed_psnr(SavedRun& run, const PackedScene& scene) {
    const std::vector<View>& views = run.scene.test;
    EvalOptions options;
    options.correction = run.correction;
    Gaussians model = packed_geometry(scene);
    model.ppisp = run.backend->download_ppisp();
    const auto backend = make_backend(run.options.device, model.appearance, engine_options(run.options));
    double psnr = 0;
    for (const View& view : views) {
        set_packed_colors(scene, camera_params<double>(view.camera).position, model);
        backend->upload(model);
        psnr += evaluate_views(*backend, {view}, run.background, options).psnr / double(views.size());
    }
    return psnr;
}

PackingLoss packing_loss(SavedRun& run, const PackedScene& scene) {
    EvalOptions options;
    options.correction = run.correction;
    return {.psnr = evaluate_views(*run.backend, run.scene.test, run.background, options).psnr,
            .packed_psnr = packed_psnr(run, scene)};
}

PackedPpisp packed_correction(SavedRun& run, const std::vector<View>& views) {
    const PpispState state = run.backend->download_ppisp();
    PackedPpisp packed = pack_ppisp(state);
    for (const View& view : views) {
        RenderRequest request;
        request.camera = camera_params(view.camera);
        request.background = run.background;
        RenderedImage image;
        run.backend->render(request, image);
        packed.views.push_back(packed_frame(state, view_isp(view, run.correction), image));
    }
    return packed;
}

std::vector<ExportedModel> export_web(const ExportRequest& request, const SiteOptions& site) {
    const std::filesystem::path folder = request.output, viewer = viewer_folder();
    require_free(folder,
                 {site_file::kScene, site_file::kSecondScene, site_file::kDescription, site_file::kPhotographs,
                  site_file::kPage, site_file::level(1)},
                 request.overwrite);
    require_page(site, !viewer.empty());
    std::vector<std::filesystem::path> runs = {request.run};
    if (!site.second_run.empty()) runs.push_back(site.second_run);
    const bool described = runs.size() > 1 || site.photographs > 0 || site.levels;
    nlohmann::ordered_json description = {{"version", 1}, {"generator", version_text()}};

    Staging staging(folder);
    std::vector<PackedRun> packed;
    for (std::size_t i = 0; i < runs.size(); ++i) {
        const char* file = i == 0 ? site_file::kScene : site_file::kSecondScene;
        packed.push_back(pack_run(request, runs[i], site, described, site.levels && i == 0, !viewer.empty() && i == 0));
        if (i > 0) require_same_views(packed[0], packed[i], request, site);
        write_ngsplat(staging.path() / file, packed[i].levels[0].scene);
        description["models"].push_back({{"file", file}, {"name", run_names(runs)[i]}});
    }
    if (site.levels) description["levels"] = write_levels(staging.path(), packed[0]);
    if (site.photographs > 0)
        description["photographs"] = write_photographs(staging.path(), packed[0], site.photographs);
    if (described) write_text_atomic(staging.path() / site_file::kDescription, json_text(description));
    if (!viewer.empty()) write_page(staging.path(), viewer, packed[0], site);
    const std::vector<std::filesystem::path> written = staging.files();
    staging.publish();
    remove_earlier_site(folder, written);
    if (!viewer.empty()) remove_other_versions(viewer, folder);

    std::vector<ExportedModel> exported;
    for (std::size_t i = 0; i < packed.size(); ++i) {
        const std::filesystem::path file = folder / (i == 0 ? site_file::kScene : site_file::kSecondScene);
        log_packed(file, packed[i]);
        const auto& [scene, loss] = packed[i].levels[0];
        exported.push_back({file, std::int64_t(scene.count()), loss});
    }
    if (site.levels) log_levels(packed[0]);
    for (std::size_t k = 1; k < packed[0].levels.size(); ++k) {
        const auto& [scene, loss] = packed[0].levels[k];
        exported.push_back({folder / site_file::level(k), std::int64_t(scene.count()), loss});
    }
    if (viewer.empty())
        log_warning("the web viewer is not built, so that only the scene was written; scripts/build-viewer builds it");
    else
        log_info("show it with: gsapp view {}", folder.string());
    return exported;
}

ExportedModel export_file(const ExportRequest& request, SplatFormat format, bool sh_projection) {
    const char* name = format == SplatFormat::kPly ? "point_cloud.ply" : "point_cloud.splat";
    const std::filesystem::path path = request.is_file ? request.output : request.output / name;
    require_free(path.parent_path(), {path.filename().string()}, request.overwrite);
    SavedModel saved = read_saved_model(request.run, request.iteration);
    Frame frame = saved.frame.value_or(Frame{});
    require_finite(saved.state);
    saved.state = visible_gaussians(saved.state);
    if (saved.state.ppisp.active())
        log_warning("the file cannot hold the photometric correction: colours are those before it");
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    if (!request.up.empty()) {
        rotation = turn_of(request.up, cameras_of(request));
        frame.center = rotation * frame.center;
    }
    if (format == SplatFormat::kSplat) {
        ShProjection mean = project_to_sh(saved.state, 0);
        if (!request.up.empty()) turn(mean.gaussians, rotation);
        write_splat(path, mean.gaussians, frame);
        if (const Eigen::Vector3d offset = file_offset(frame); !offset.isZero(0))
            log_warning("{}: positions lack the offset ({}, {}, {}), for which its floats are too coarse",
                        path.string(), offset.x(), offset.y(), offset.z());
        log_info("{}: {} Gaussians in their mean colour, {:.2f} dB to their colours over all directions", path.string(),
                 saved.state.count, mean.psnr);
        return {path, saved.state.count};
    }
    PlyOptions options{.iteration = saved.iteration, .frame = frame};
    if (sh_projection && !is_plain_sh(saved.state)) {
        ShProjection projection = project_to_sh(saved.state, 3);
        options.note = fmt::format("spherical harmonics fitted to the colours of {}, {:.2f} dB over all directions",
                                   saved.state.appearance.model, projection.psnr);
        log_info("{}", options.note);
        saved.state = std::move(projection.gaussians);
    }
    if (!request.up.empty()) turn(saved.state, rotation);
    write_ply(path, saved.state, options);
    log_info("{}: {} Gaussians", path.string(), saved.state.count);
    if (!is_plain_sh(saved.state))
        log_info(
            "other programs show its base colours; --sh-projection fits spherical harmonics, which show view "
            "dependence");
    return {path, saved.state.count};
}

}  // namespace gs
