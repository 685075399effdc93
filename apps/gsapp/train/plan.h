// SPDX-License-Identifier: Apache-2.0
// The plan of a run with constraints, and its outcome: the number of Gaussians that fit into a file, and the estimated
// losses from a shorter training and fewer Gaussians (docs/lab/limits.md#what-the-plan-estimates).
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

/// Returns the PSNR loss of a training with recipe frontier that uses each view `rounds` > 0 times, against the same
/// training of unlimited length, dB.
double loss_of_length(double rounds);

/// Returns the PSNR loss of a model of `count` > 0 Gaussians against one of `most`, dB, if the scene has enough detail
/// for `most`.
double loss_of_count(std::int64_t count, std::int64_t most);

/// Formats a loss: "about 0.3 dB", "less than 0.1 dB", "more than 10 dB".
std::string about(double loss);

/// The number of Gaussians that fit into a file of limited size.
struct SizePlan {
    std::int64_t limit = 0;                    ///< bytes
    std::int64_t fixed = 0, per_gaussian = 0;  ///< bytes of the file: fixed, and per Gaussian
    std::int64_t per_residual = 0;             ///< additional bytes of a Gaussian with a residual
    double share = 1;                          ///< share of Gaussians with a residual
    std::int64_t unit = 1;                     ///< Gaussians are padded to a multiple of this
    std::int64_t most_gaussians = 0;           ///< largest number of Gaussians that fits

    /// Returns the size of a file of `count` Gaussians, overestimated by at most 4 KiB.
    std::int64_t bytes(std::int64_t count) const;
    /// Returns the mean size of a Gaussian in the file.
    double mean_bytes() const { return double(per_gaussian) + share * double(per_residual); }
};

/// Returns the plan for options.size_limit, which must not be empty. Throws UsageError naming the smallest possible
/// size if not even one Gaussian fits.
SizePlan plan_size(const TrainOptions& options, const Scene& scene);

/// The plan of a run with constraints, and its outcome.
struct TrainingPlan {
    std::vector<std::string> lines;  ///< lines for readers, before the training
    std::string estimate;            ///< loss from the length, and the option that changes it; empty if not estimated
    nlohmann::ordered_json json;     ///< plan for results.json; null without constraints
    std::optional<SizePlan> size;    ///< set with --size-limit
    std::size_t num_views = 0;       ///< number of training views
    std::int64_t full_count = 0;     ///< Gaussians of the full run, the reference of the loss estimates
    std::string full_count_reason;   ///< limit on the Gaussians of a full run
};

/// Returns the plan of a run; empty if `options` contain no limit, target or preset. Throws UsageError for a limit that
/// cannot be met. `held_out` is the number of views held out for --target-psnr.
TrainingPlan make_plan(const TrainOptions& options, const Scene& scene, std::size_t held_out = 0);

/// Describes the constraints of `options` and `plan` for the line that opens a training: "at most 100000 Gaussians
/// (--cap-max), 30000 iterations".
std::string training_words(const TrainingPlan& plan, const TrainOptions& options);

/// Adds the outcome to the plan's json and to the log.
void note_outcome(TrainingPlan& plan, const TrainOptions& options, const TrainSummary& summary);

}  // namespace gs
