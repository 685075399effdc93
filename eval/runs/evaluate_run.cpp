// SPDX-License-Identifier: Apache-2.0
// Scores an open run and merges the scores into its files.
#include "eval/runs/evaluate_run.h"

#include <fmt/format.h>

#include "eval/bench/bench.h"
#include "lib/core/log.h"
#include "lib/train/scene_options.h"

namespace gs {

std::filesystem::path results_folder(const std::filesystem::path& run, const std::string& source) {
    return source.empty() ? run : run / ("on-" + scene_name(source));
}

EvalResult evaluate_run(SavedRun& run, const EvalOptions& options, int frame_rounds,
                        const std::filesystem::path& results) {
    const std::string folder = run.folder.string();
    const std::string model =
        is_point_cloud(run.folder) ? folder : fmt::format("{}: iteration {}", folder, run.iteration);
    log_info("{}, {} Gaussians, {} test views of {}, photometric correction: {}", model, run.backend->count(),
             run.scene.test.size(), run.options.source, correction_name(options.correction.mode));
    const EvalResult result = evaluate_views(*run.backend, run.scene.test, run.background, options);
    if (result.residual_mean) log_info("{}: mean of the residual pictures {:.4f}", folder, *result.residual_mean);
    for (const auto& [key, score] : result.scores) {
        if (!score.value) log_warning("{}: {} {}", folder, key, score.reason);
    }
    RunFacts facts = run_facts(run.options, run.scene, run.background, *run.backend);
    if (frame_rounds > 0)
        facts.frame_seconds = frame_seconds(*run.backend, run.scene.test, run.background, frame_rounds);
    write_results(RunFolder{results}, options, result, facts);
    return result;
}

}  // namespace gs
