// SPDX-License-Identifier: Apache-2.0
// Scores the held-out views and writes the results during training.
#include "eval/runs/training_evaluation.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/bench/bench.h"
#include "eval/runs/evaluate.h"
#include "eval/runs/saved_run.h"
#include "lib/core/log.h"
#include "lib/core/options.h"
#include "lib/model/cameras_json.h"
#include "lib/scene/resized.h"

namespace gs {
namespace {

constexpr int kComparisonViews = 4;  // enough to judge a scene, and fits on one screen

/// Pixels; wider pictures of corrected views are made smaller.
constexpr int kCorrectionWidth = 400;

/// Writes pictures of the training views with the largest corrections: the photograph and the render, above with the
/// dataset's camera, below with the learned one.
void write_corrections(const RunFolder& folder, Backend& backend, const Scene& scene, const Vec3<float>& background,
                       const EvalCorrection& correction) {
    const std::vector<ListedView> corrected = corrected_views(read_cameras_json(folder.cameras()));
    for (std::size_t rank = 0; rank < std::min(corrected.size(), RunFolder::kCorrections); ++rank) {
        const auto view = std::find_if(scene.train.begin(), scene.train.end(),
                                       [&](const View& v) { return v.name == corrected[rank].name; });
        if (view == scene.train.end() || !view->given) continue;
        const View learned = smaller_view(*view, kCorrectionWidth);
        View given = learned;
        given.camera = *learned.given;
        write_comparison(folder.correction(rank), backend, {given, learned}, background, 2, correction);
    }
}

}  // namespace

void add_training(RunResult& result, const TrainSummary& summary) {
    if (summary.whole_time) result.train_seconds = summary.train_seconds;
    if (summary.controller_seconds > 0) result.controller_seconds = summary.controller_seconds;
    if (summary.memory.peak > 0) result.peak_device_bytes = summary.memory.peak;
    if (!summary.photometric.empty()) result.photometric = summary.photometric;
    if (!summary.refine_cameras.empty()) result.refine_cameras = summary.refine_cameras;
}

TrainingEvaluation::TrainingEvaluation(const TrainOptions& options, const Scene& scene, Progress& progress,
                                       int frame_rounds)
    : options_(options), scene_(scene), progress_(progress), frame_rounds_(frame_rounds) {
    background_ = options.background.color;  // black if training draws random colours
}

std::optional<TestScores> TrainingEvaluation::operator()(std::int64_t iteration, Backend& backend, bool last) {
    // Images of intermediate iterations would fill disks; only their scores are kept.
    const EvalOptions eval{.run_folder = last ? std::filesystem::path(options_.model) : std::filesystem::path(),
                           .iteration = iteration,
                           .split_rule = scene_.split_rule,
                           .correction = saved_correction(options_.model)};
    result_ = evaluate_views(backend, scene_.test, background_, eval);
    add_run_facts(result_, options_, scene_, backend);
    if (last && frame_rounds_ > 0)
        result_.frame_seconds = frame_seconds(backend, scene_.test, background_, frame_rounds_);
    write_results(RunFolder{options_.model}, result_);
    if (last) {
        write_comparison(comparison(), backend, scene_.test, background_, kComparisonViews, eval.correction);
        write_corrections(RunFolder{options_.model}, backend, scene_, background_, eval.correction);
    }
    const bool corrected = eval.correction.mode != CorrectionMode::kOff;
    log_info("iteration {}: PSNR {:.2f}, SSIM {:.4f} on {} test views{}", iteration, result_.psnr, result_.ssim,
             result_.views.size(),
             corrected ? fmt::format(", photometric correction: {}", correction_name(eval.correction.mode)) : "");
    progress_.event({{"event", "evaluation"},
                     {"iteration", iteration},
                     {"views", result_.views.size()},
                     {"psnr", result_.psnr},
                     {"ssim", result_.ssim},
                     {"ppisp_eval", correction_name(eval.correction.mode)}});
    return TestScores{result_.psnr, result_.ssim, result_.views.size()};
}

void TrainingEvaluation::finish(const TrainSummary& summary, const nlohmann::ordered_json& plan) {
    add_training(result_, summary);
    result_.plan = plan;
    result_.appearance_choice = read_appearance_choice(options_.model);
    write_results(RunFolder{options_.model}, result_);
    log_debug("photographs and renders side by side: {}", comparison().string());
}

std::filesystem::path TrainingEvaluation::comparison() const {
    return std::filesystem::path(options_.model) / "comparison.png";
}

}  // namespace gs
