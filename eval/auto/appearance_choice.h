// SPDX-License-Identifier: Apache-2.0
// The rules of `--appearance auto`: the interpretation of the measurements, the choice of one model, and the report of
// it for readers and programs.
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
    std::int64_t bytes = 0;  ///< appearance bytes per Gaussian, as trained
    double seconds = 0;      ///< time per iteration
    double psnr = 0;         ///< mean over the held-out views, dB; NaN or infinite: the trial failed
};

struct AppearanceChoice {
    std::size_t chosen = 0, best = 0;  ///< indices into the trials
};

/// Chooses the model with the fewest bytes, then with the least time, whose PSNR is at most `tolerance` dB below the
/// best. `trials` must have at least one entry. Failed trials are skipped; if all failed, the first one is chosen.
AppearanceChoice choose_appearance(const std::vector<AppearanceTrial>& trials, double tolerance);

/// The main component of the error of a model without view dependence.
enum class RemainingError {
    kReflectance,    ///< the error depends on the direction
    kPhotometric,    ///< whole images are brighter, darker or tinted
    kInconsistency,  ///< view dependence learnt from some images is wrong in others: the images contradict each other
    kUnresolved,     ///< none of these: detail that a short training has not resolved
};

/// Returns the rise of PSNR, in dB, if this share of the squared error were removed.
double gain_in_decibels(double share);

/// Returns the main cause of the error. `tolerance`: the rise of PSNR, in dB, above which direction counts as a cause.
RemainingError classify_remaining_error(const ResidualParts& parts, double tolerance);

/// Returns whether models need trials: direction explains more than `tolerance` dB.
bool needs_trials(const ResidualParts& parts, double tolerance);

/// The reason why nothing could be measured.
enum class Obstacle {
    kFewViews,  ///< fewer than kFewestViews training views, so that none can be held out
    kMasks,     ///< masks exclude every pixel of the views that models would be compared on
    kShort,     ///< the run or its time limit is too short for meaningful trials
    kLate,      ///< no trial ended in its share of the time limit
};

/// Smallest number of iterations in a trial for comparing models: shorter trials only rank how fast models start.
inline constexpr std::int64_t kFewestTrialIterations = 500;

/// The inputs of the choice and of its description.
struct AppearanceMeasurements {
    /// If set, only num_views, one_sided, plain_model, trial_iterations and seconds are certain to be known.
    std::optional<Obstacle> obstacle = {};
    std::size_t num_views = 0, num_held_out = 0;  ///< training views, and the number of these held out
    bool one_sided = false;                       ///< whether all training cameras look in nearly the same direction
    int image_width = 0, image_height = 0;        ///< size of the first training image, pixels
    std::int64_t warm_up_iterations = 0, trial_iterations = 0;
    std::string plain_model = {};              ///< the model without view dependence from which all trials start
    std::int64_t plain_bytes = 0;              ///< its appearance bytes per Gaussian
    ResidualParts parts = {};                  ///< composition of that model's errors
    std::vector<AppearanceTrial> trials = {};  ///< empty unless needs_trials
    std::vector<std::string> unfinished = {};  ///< models left out for lack of time
    double seconds = 0;                        ///< duration of all measurements
};

/// The decision drawn from the measurements.
struct AppearanceDecision {
    std::string model;  ///< model to train
    RemainingError remaining = RemainingError::kUnresolved;
    std::optional<AppearanceChoice> choice = {};  ///< choice among the trials; empty if no model was tried
};

/// Chooses among the trials as choose_appearance does. Without trials returns the plain model; if the obstacle is
/// kShort or kLate, returns sv (sh if one_sided) instead.
AppearanceDecision decide_appearance(const AppearanceMeasurements& measured, double tolerance);

/// The report of `--appearance auto` on its choice, for readers and for programs.
struct AppearanceReport {
    std::string model;  ///< model to train
    /// Lines for readers: five on the procedure, its results, and the reason for the choice; one if nothing could be
    /// measured.
    std::vector<std::string> lines;
    nlohmann::ordered_json json;  ///< the same for programs: auto.json
};

/// Returns the reason for missing measurements; measured.obstacle must be set.
std::string obstacle_text(const AppearanceMeasurements& measured);

/// Describes a decision based on these measurements and this tolerance (dB).
AppearanceReport describe_appearance(const AppearanceMeasurements& measured, const AppearanceDecision& decision,
                                     double tolerance);

}  // namespace gs
