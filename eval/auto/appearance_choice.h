// SPDX-License-Identifier: Apache-2.0
// The rules of `--appearance auto`: from what was measured to what it means, to one model, and to what is said about
// it, for people and for programs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "eval/auto/residual_parts.h"

namespace gs {

/// One model after its trial.
struct AppearanceTrial {
    std::string model;
    std::int64_t bytes = 0;  ///< size of the appearance of one Gaussian, as trained
    double seconds = 0;      ///< time of an iteration
    double psnr = 0;         ///< mean over the held-out views, dB; NaN or infinite: the trial failed
};

struct AppearanceChoice {
    std::size_t chosen = 0, best = 0;  ///< indices into the trials
};

/// Keeps the model of fewest bytes, then of least time, whose PSNR is at most `tolerance` dB below the best. `trials`:
/// at least one. Those that failed are passed over; where all did, the first is kept.
AppearanceChoice choose_appearance(const std::vector<AppearanceTrial>& trials, double tolerance);

/// What the error of a model without view dependence is made of.
enum class RemainingError {
    kReflectance,    ///< it depends on the direction
    kPhotometric,    ///< whole images are brighter, darker or tinted
    kInconsistency,  ///< what depends on the direction in some images is wrong in others: they contradict each other
    kUnresolved,     ///< none of these: detail that a short training has not reached
};

/// The rise of PSNR, in dB, if this share of the squared error went away.
double gain_in_decibels(double share);

/// Names the main cause of the error. `tolerance`: the rise of PSNR, in dB, from which direction counts as a cause.
RemainingError classify_remaining_error(const ResidualParts& parts, double tolerance);

/// Whether models have to be tried: direction explains more than `tolerance` dB.
bool needs_trials(const ResidualParts& parts, double tolerance);

/// Why nothing could be measured.
enum class Obstacle {
    kFewViews,  ///< there are fewer than kFewestViews training views, and none can be held out
    kMasks,     ///< masks leave nothing of the views that models would be compared on
    kShort,     ///< the run is too short, or its time limit, for trials that tell anything
    kLate,      ///< no trial ended in its part of the time limit
};

/// The iterations of a trial below which models are not compared: shorter ones rank how fast models begin.
inline constexpr std::int64_t kFewestTrialIterations = 500;

/// Everything that the choice is made from, and what its description needs.
struct AppearanceMeasurements {
    /// If set, only num_views, one_sided, plain_model, trial_iterations and seconds are known
    std::optional<Obstacle> obstacle = {};
    std::size_t num_views = 0, num_held_out = 0;  ///< training views, and those of them that were held out
    bool one_sided = false;                       ///< all training cameras look nearly the same way
    int image_width = 0, image_height = 0;        ///< size of the first image that was trained on, pixels
    std::int64_t warm_up_iterations = 0, trial_iterations = 0;
    std::string plain_model = {};              ///< the model without view dependence that all trials go on from
    std::int64_t plain_bytes = 0;              ///< size of its appearance of one Gaussian
    ResidualParts parts = {};                  ///< what that model's errors consist of
    std::vector<AppearanceTrial> trials = {};  ///< empty unless needs_trials
    std::vector<std::string> unfinished = {};  ///< models that there was no time for
    double seconds = 0;                        ///< time that all of this took
};

/// What the measurements say.
struct AppearanceDecision {
    std::string model;  ///< to train
    RemainingError remaining = RemainingError::kUnresolved;
    std::optional<AppearanceChoice> choice = {};  ///< among the trials; empty if no model was tried
};

/// Chooses among the trials as choose_appearance does; the plain model if none was needed, or possible.
AppearanceDecision decide_appearance(const AppearanceMeasurements& measured, double tolerance);

/// What `--appearance auto` says about its choice, for people and for programs.
struct AppearanceReport {
    std::string model;               ///< to train
    std::vector<std::string> lines;  ///< for people: five on what was done, what came out of it, and why; one where
                                     ///< nothing could be measured
    nlohmann::ordered_json json;     ///< the same for programs: auto.json
};

/// Returns why there are no measurements; measured.obstacle is set.
std::string obstacle_text(const AppearanceMeasurements& measured);

/// Describes a decision that was made from these measurements with this tolerance (dB).
AppearanceReport describe_appearance(const AppearanceMeasurements& measured, const AppearanceDecision& decision,
                                     double tolerance);

}  // namespace gs
