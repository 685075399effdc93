// SPDX-License-Identifier: Apache-2.0
// What a run with constraints intends, and what came of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "eval/experiments/size_plan.h"
#include "lib/core/train_options.h"
#include "lib/train/trainer.h"

namespace gs {

struct Plan {
    std::vector<std::string> lines;  ///< for people, before the training
    std::string estimate;            ///< what the length costs, and the option that changes it; empty if not estimated
    nlohmann::ordered_json json;     ///< for results.json; null without constraints
    std::optional<SizePlan> size;    ///< with --size-limit
    std::size_t num_views = 0;       ///< views that are trained on
    std::int64_t full_count = 0;     ///< Gaussians of the full run that losses are estimated against
    std::string full_count_reason;   ///< what keeps a full run from more of them
};

/// Returns the plan of a run; empty if `options` name neither limit, target nor preset. Throws UsageError for a limit
/// that cannot be met. `held_out` is the number of views held out for --target-psnr.
Plan make_plan(const TrainOptions& options, const Scene& scene, std::size_t held_out = 0);

/// Returns what `options` and `plan` ask for, in words for the line that opens a training: "at most 100000 Gaussians
/// (--cap-max), 30000 iterations".
std::string training_words(const Plan& plan, const TrainOptions& options);

/// Adds what came of it to the plan's json and to the log.
void note_outcome(Plan& plan, const TrainOptions& options, const TrainSummary& summary);

}  // namespace gs
