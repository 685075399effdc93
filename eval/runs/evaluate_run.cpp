// SPDX-License-Identifier: Apache-2.0
// Scores an open run and merges the scores into its files.
#include "eval/runs/evaluate_run.h"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <optional>
#include <set>

#include "eval/bench/bench.h"
#include "eval/runs/results.h"
#include "lib/core/input_file.h"
#include "lib/core/log.h"
#include "lib/io/temporary.h"
#include "lib/scene/scene.h"
#include "lib/train/align_cameras.h"

namespace gs {

namespace fs = std::filesystem;
namespace {

/// The images of an evaluation, collected in a work folder; their final folder stays unchanged until commit().
class NewPictures {
  public:
    NewPictures(const fs::path& folder, const std::string& split) : folder_(folder) {
        for (fs::path at = folder_; !at.empty() && !path_exists(at); at = at.parent_path()) missing_.push_back(at);
        work_.emplace(folder_ / split);
    }
    ~NewPictures() {
        work_.reset();
        std::error_code ignored;  // removes only folders that stayed empty
        for (const fs::path& made : missing_) fs::remove(made, ignored);
    }
    NewPictures(const NewPictures&) = delete;
    NewPictures& operator=(const NewPictures&) = delete;

    const fs::path& path() const { return work_->path(); }

    /// Moves the images to their final folders. Throws DataError.
    void commit() {
        std::set<fs::path> changed;
        for (const auto& entry : fs::recursive_directory_iterator(path())) {
            if (!entry.is_regular_file()) continue;
            const fs::path target = folder_ / entry.path().lexically_relative(path());
            if (changed.insert(target.parent_path()).second) create_folders(target.parent_path(), target);
            if (std::rename(entry.path().c_str(), target.c_str()) != 0) fail_to_write("replace", target, errno);
        }
        for (const fs::path& part : changed) sync_folder(part, part);
    }

  private:
    const fs::path folder_;
    std::vector<fs::path> missing_;  ///< the folder and its ancestors that did not exist
    std::optional<WorkFolder> work_;
};

/// Scores the views once more, with their cameras aligned to the model.
void add_aligned_scores(SavedRun& run, EvalOptions options, RunResult& result) {
    constexpr int kSteps = 120;
    const AlignedViews aligned = align_cameras(*run.backend, run.scene.test, run.background, kSteps);
    options.run_folder.clear(), options.metrics.clear(), options.decompose = false;
    const RunResult scores = evaluate_views(*run.backend, aligned.views, run.background, options);
    result.aligned_psnr = scores.psnr, result.aligned_ssim = scores.ssim;
    result.aligned_pixels = aligned.median_pixels;
    log_info("{}: with test cameras aligned to the model, by {:.2f} pixels in the median: PSNR {:.2f}, SSIM {:.4f}",
             run.folder.string(), aligned.median_pixels, scores.psnr, scores.ssim);
}

}  // namespace

std::filesystem::path results_folder(const std::filesystem::path& run, const RunChanges& changes) {
    const std::string lens = changes.lens ? "-" + std::string(kWordsOf<LensMode>[std::size_t(*changes.lens)]) : "";
    if (!changes.source.empty()) return run / ("on-" + scene_name(changes.source) + lens);
    return changes.lens ? run / ("on" + lens) : run;
}

RunResult evaluate_run(SavedRun& run, const EvalOptions& options, int frame_rounds,
                       const std::filesystem::path& results) {
    const std::string folder = run.folder.string();
    const std::string model =
        is_point_cloud(run.folder) ? folder : fmt::format("{}: iteration {}", folder, run.iteration);
    log_info("{}, {} Gaussians, {} test views of {}, photometric correction: {}", model, run.backend->count(),
             run.scene.test.size(), run.options.source, correction_name(options.correction.mode));
    std::optional<NewPictures> pictures;
    EvalOptions own = options;
    own.split_rule = run.scene.split_rule;
    if (!options.run_folder.empty()) {
        pictures.emplace(options.run_folder, options.split);
        own.run_folder = pictures->path();
    }
    RunResult result = evaluate_views(*run.backend, run.scene.test, run.background, own);
    if (result.residual_mean) log_info("{}: mean of the residual pictures {:.4f}", folder, *result.residual_mean);
    for (const auto& [key, score] : result.scores) {
        if (!score.value) log_warning("{}: {} {}", folder, key, score.reason);
    }
    if (options.align_cameras) add_aligned_scores(run, own, result);
    add_run_facts(result, run.options, run.scene, *run.backend);
    if (frame_rounds > 0)
        result.frame_seconds = frame_seconds(*run.backend, run.scene.test, run.background, frame_rounds);
    if (pictures) pictures->commit();
    write_results(RunFolder{results}, result);
    return result;
}

}  // namespace gs
