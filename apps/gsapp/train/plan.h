// SPDX-License-Identifier: Apache-2.0
// What a run with constraints intends, and what came of it: how many Gaussians fit into a file, and what a shorter
// training and fewer Gaussians cost (docs/lab/limits.md#what-the-plan-estimates).
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "lib/core/train_options.h"
#include "lib/scene/scene.h"
#include "lib/train/trainer.h"

namespace gs {

/// Returns the PSNR that training by recipe frontier gives up against the same with all the time it can use, dB, where
/// each view is seen `rounds` > 0 times.
double loss_of_length(double rounds);

/// Returns the PSNR that a model of `count` > 0 Gaussians gives up against one of `most`, dB, where the scene has
/// detail enough for `most`.
double loss_of_count(std::int64_t count, std::int64_t most);

/// Puts a loss into words: "about 0.3 dB", "less than 0.1 dB", "more than 10 dB".
std::string about(double loss);

/// How many Gaussians fit into a file of limited size.
struct SizePlan {
    std::int64_t limit = 0;                    ///< bytes
    std::int64_t fixed = 0, per_gaussian = 0;  ///< bytes of the file
    std::int64_t per_residual = 0;             ///< bytes that a Gaussian with a residual takes besides
    double share = 1;                          ///< share of the Gaussians that have one
    std::int64_t unit = 1;                     ///< Gaussians are padded to a multiple of this
    std::int64_t most_gaussians = 0;           ///< the most that fit

    /// Returns the size of a file of `count` Gaussians, at most 4 KiB too much.
    std::int64_t bytes(std::int64_t count) const;
    /// Returns the mean size of a Gaussian in it.
    double mean_bytes() const { return double(per_gaussian) + share * double(per_residual); }
};

/// Returns the plan for options.size_limit, which must not be empty. Throws UsageError naming the smallest size if not
/// even one Gaussian fits.
SizePlan plan_size(const TrainOptions& options, const Scene& scene);

/// What a run with constraints intends, and what came of it.
struct TrainingPlan {
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
TrainingPlan make_plan(const TrainOptions& options, const Scene& scene, std::size_t held_out = 0);

/// Returns what `options` and `plan` ask for, in words for the line that opens a training: "at most 100000 Gaussians
/// (--cap-max), 30000 iterations".
std::string training_words(const TrainingPlan& plan, const TrainOptions& options);

/// Adds what came of it to the plan's json and to the log.
void note_outcome(TrainingPlan& plan, const TrainOptions& options, const TrainSummary& summary);

}  // namespace gs
