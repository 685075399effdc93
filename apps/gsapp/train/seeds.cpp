// SPDX-License-Identifier: Apache-2.0
// Sets the seed and folder of each run.
#include "apps/gsapp/train/seeds.h"

#include <fmt/format.h>

#include "apps/gsapp/train/train_run.h"
#include "eval/experiments/job.h"
#include "eval/runs/run_scene.h"
#include "kernels/base/error.h"
#include "lib/core/log.h"
#include "lib/scene/scene.h"

namespace gs {

std::vector<RunResult> train_seeds(TrainOptions base, int num_runs, const TrainRun& train) {
    if (!base.resume.empty())
        throw UsageError("--runs: runs are not resumed; the same command again trains those that are missing");
    require_named_appearance(base);
    if (!base.eval) throw UsageError("--runs: there is nothing to average without --eval");
    if (base.model.empty()) base.model = free_run_folder("output", base, "-0");
    std::vector<RunResult> results;
    for (int k = 0; k < num_runs; ++k) {
        TrainOptions options = base;
        options.seed = base.seed + std::uint64_t(k);
        set_folder(options, fmt::format("{}-{}", base.model, k));
        std::optional<RunResult> result;
        if (!options.overwrite) result = finished_run(options);
        if (result) {  // the scene may have changed since
            require_run_scene(options.model, options, load_scene(options));
            log_info("run {} of {}: finished before in {}", k + 1, num_runs, options.model);
        } else {
            result = train(options);
        }
        if (result) results.push_back(*result);
    }
    return results;
}

}  // namespace gs
