// SPDX-License-Identifier: Apache-2.0
// The thresholds and comparisons that turn measurements into a verdict.
#include "eval/auto/appearance_choice.h"

#include <algorithm>
#include <cmath>
#include <tuple>

namespace gs {
namespace {

/// Images contradict each other where direction, as learnt from some, adds more than this to the error of others, and
/// more than half of what it takes off theirs. Measured: builtin:moved -0.42 (0.09 taken off the others),
/// builtin:shadow -0.08 (0.03); builtin:polished -0.01 (0.06), diffuse 0.01, glossy 0.07, exposure 0.09, lego 0.13.
constexpr double kNotableHarm = 0.03;
/// The share of an affine map of colours from which images count as differently exposed: builtin:exposure 0.68, all
/// others up to 0.16, which short trainings leave.
constexpr double kNotablePhotometric = 0.3;

/// Returns the model to train where trials would be too short: sv does best on most scenes, but sh where all cameras
/// look nearly the same way (docs/lab/limits.md#auto-under-a-limit).
const char* untold_model(bool one_sided) { return one_sided ? "sh" : "sv"; }

bool worked(const AppearanceTrial& trial) { return std::isfinite(trial.psnr); }

}  // namespace

AppearanceChoice choose_appearance(const std::vector<AppearanceTrial>& trials, double tolerance) {
    AppearanceChoice choice;
    const auto best =
        std::max_element(trials.begin(), trials.end(), [](const AppearanceTrial& a, const AppearanceTrial& b) {
            return worked(b) && (!worked(a) || a.psnr < b.psnr);
        });
    if (!worked(*best)) return choice;
    choice.best = choice.chosen = std::size_t(best - trials.begin());
    for (std::size_t k = 0; k < trials.size(); ++k) {
        const AppearanceTrial &a = trials[k], &b = trials[choice.chosen];
        if (worked(a) && a.psnr >= best->psnr - tolerance &&
            std::tie(a.bytes, a.seconds) < std::tie(b.bytes, b.seconds))
            choice.chosen = k;
    }
    return choice;
}

double gain_in_decibels(double share) { return -10 * std::log10(1 - std::min(share, 1 - 1e-9)); }

RemainingError classify_remaining_error(const ResidualParts& parts, double tolerance) {
    if (-parts.held_out_direction > std::max(kNotableHarm, parts.direction / 2)) return RemainingError::kInconsistency;
    if (parts.photometric > kNotablePhotometric) return RemainingError::kPhotometric;
    return gain_in_decibels(parts.direction) > tolerance ? RemainingError::kReflectance : RemainingError::kUnresolved;
}

bool needs_trials(const ResidualParts& parts, double tolerance) {
    return gain_in_decibels(parts.direction) > tolerance;
}

AppearanceDecision decide_appearance(const AppearanceMeasurements& measured, double tolerance) {
    const bool untold = measured.obstacle == Obstacle::kShort || measured.obstacle == Obstacle::kLate;
    AppearanceDecision decision{untold ? untold_model(measured.one_sided) : measured.plain_model};
    if (measured.obstacle) return decision;
    decision.remaining = classify_remaining_error(measured.parts, tolerance);
    if (measured.trials.empty()) return decision;
    decision.choice = choose_appearance(measured.trials, tolerance);
    decision.model = measured.trials[decision.choice->chosen].model;
    return decision;
}

}  // namespace gs
