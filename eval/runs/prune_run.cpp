// SPDX-License-Identifier: Apache-2.0
// Prunes, scores before and after, and writes the pruned run.
#include "eval/runs/prune_run.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/runs/prune_appearance.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/options.h"
#include "lib/core/run_config.h"
#include "lib/export/pack_scene.h"
#include "lib/io/atomic_file.h"
#include "lib/model/ply.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

namespace fs = std::filesystem;

/// Writes a folder like the run's: the pruned model, and what opening it needs.
void write_run(const SavedRun& run, const Gaussians& pruned, const fs::path& output) {
    const RunFolder from{run.folder}, to{output};
    write_ply(to.point_cloud(run.iteration), pruned, {.iteration = run.iteration, .frame = run.scene.frame});
    TrainOptions options = run.options;
    options.model = output.string();
    write_text_atomic(to.config(), run_config(options));
    write_cfg_args(to, options);
    for (const auto file :
         {&RunFolder::cameras, &RunFolder::input_points, &RunFolder::ppisp, &RunFolder::appearance_choice})
        if (path_exists((from.*file)())) copy_file_atomic((from.*file)(), (to.*file)());
}

PruneScores score(SavedRun& run) {
    EvalOptions options;
    options.correction = run.correction;
    const EvalResult result = evaluate_views(*run.backend, run.scene.test, run.background, options);
    return {result.psnr, result.ssim};
}

double share(const PruneReport& report) {
    return double(report.pruned) / double(std::max<std::int64_t>(1, report.num_gaussians));
}

nlohmann::ordered_json json_of(const PruneScores& scores) { return {{"PSNR", scores.psnr}, {"SSIM", scores.ssim}}; }

}  // namespace

fs::path pruned_folder(const fs::path& run) {
    return (run.has_filename() ? run : run.parent_path()).string() + "-pruned";
}

PruneReport prune_run(SavedRun& run, const fs::path& output) {
    const Gaussians model = run.backend->download(false);
    require_finite(model);
    std::vector<CameraParams<float>> cameras;
    for (const View& view : run.scene.train) cameras.push_back(camera_params(view.camera));
    PruneReport report{.run = run.folder.string(),
                       .iteration = run.iteration,
                       .num_gaussians = model.count,
                       .num_cameras = cameras.size(),
                       .split_rule = run.scene.split_rule};
    const std::vector<std::uint8_t> shown = shown_residuals(model, cameras);
    const int width = model[Group::kResidual].width;
    report.pruned = model.num_residuals() - std::count(shown.begin(), shown.end(), 1);
    report.bytes_saved = report.pruned * width * std::int64_t(sizeof(float));
    if (!run.scene.test.empty()) report.before = score(run);
    run.backend->keep_residuals(shown, {});
    if (!run.scene.test.empty()) report.after = score(run);
    write_run(run, run.backend->download(false), output);
    write_text_atomic(output / "pruned.json", json_text(prune_report_json(report), 1) + "\n");
    return report;
}

std::string format_prune_report(const PruneReport& r) {
    std::string text = fmt::format(
        "{} of {} Gaussians ({:.1f} %) show their view dependence in none of {} training views and lose it: {} bytes "
        "less\n",
        r.pruned, r.num_gaussians, 100 * share(r), r.num_cameras, r.bytes_saved);
    if (r.before && r.after)
        return text + fmt::format("test views: PSNR {:.3f} before, {:.3f} after; SSIM {:.5f} before, {:.5f} after\n",
                                  r.before->psnr, r.after->psnr, r.before->ssim, r.after->ssim);
    return text + fmt::format("there are no test views to compare on ({})\n", r.split_rule);
}

nlohmann::ordered_json prune_report_json(const PruneReport& r) {
    nlohmann::ordered_json json = {{"run", r.run},       {"iteration", r.iteration}, {"num_gaussians", r.num_gaussians},
                                   {"pruned", r.pruned}, {"share", share(r)},        {"bytes_saved", r.bytes_saved}};
    if (r.before) json["before"] = json_of(*r.before);
    if (r.after) json["after"] = json_of(*r.after);
    return json;
}

}  // namespace gs
