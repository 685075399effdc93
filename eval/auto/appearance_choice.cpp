// SPDX-License-Identifier: Apache-2.0
// Thresholds and comparisons that turn measurements into a decision, and its description as text and JSON.
#include "eval/auto/appearance_choice.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "eval/auto/photograph.h"

namespace gs {
namespace {

/// Images contradict each other if view dependence, learnt from some images, adds more than this share to the error of
/// others, and more than half of the share that it removes from theirs. Measured: builtin:moved -0.42 (0.09 removed
/// from theirs), builtin:shadow -0.08 (0.03); builtin:polished -0.01 (0.06), diffuse 0.01, glossy 0.07, exposure 0.09,
/// lego 0.13.
constexpr double kNotableHarm = 0.03;
/// Share of an affine colour map above which images count as differently exposed: builtin:exposure has 0.68, all other
/// scenes up to 0.16, which short trainings leave.
constexpr double kNotablePhotometric = 0.3;

/// Returns the model to train if trials would be too short: sv is best on most scenes, but sh if all cameras look in
/// nearly the same direction (docs/lab/limits.md#auto-under-a-limit).
const char* untold_model(bool one_sided) { return one_sided ? "sh" : "sv"; }

bool worked(const AppearanceTrial& trial) { return std::isfinite(trial.psnr); }

using Json = nlohmann::ordered_json;

/// A cause of errors as one word for programs, and as text for readers.
struct CauseText {
    const char *name, *words;
};

CauseText cause_text(RemainingError error) {
    switch (error) {
        case RemainingError::kReflectance:
            return {"reflectance", "reflectance"};
        case RemainingError::kPhotometric:
            return {"photometric",
                    "photometric: whole images differ in exposure or colour, which no appearance explains and --ppisp "
                    "is for"};
        case RemainingError::kInconsistency:
            return {"inconsistency",
                    "inconsistency between images (things that moved, changing light), not reflectance"};
        case RemainingError::kUnresolved:
            break;
    }
    return {"unresolved",
            "detail that a short training does not reach; less of it depends on the direction than is allowed"};
}

/// Shares of the squared error without view dependence.
struct Explained {
    double direction, direction_held_out, photometric, neither;
};

Explained explained(const ResidualParts& parts) {
    const double rest = 1 - parts.photometric, direction = rest * std::max(parts.direction, 0.0);
    return {direction, rest * parts.held_out_direction, parts.photometric, rest - direction};
}

std::string trials_text(const AppearanceMeasurements& m, double tolerance) {
    if (m.trials.empty())
        return fmt::format("no model was tried: direction is worth {:.2f} dB, and {} dB are allowed",
                           gain_in_decibels(m.parts.direction), tolerance);
    std::string text = fmt::format("held out after {} iterations of each:", m.trial_iterations);
    for (const AppearanceTrial& t : m.trials)
        text += fmt::format("{} {} {:.2f} dB ({} B)", &t == &m.trials.front() ? "" : ",", t.model, t.psnr, t.bytes);
    if (!m.unfinished.empty()) text += fmt::format("; no time to finish {}", fmt::join(m.unfinished, ", "));
    return text;
}

std::string choice_text(const AppearanceMeasurements& m, const AppearanceDecision& decision, double tolerance) {
    if (!decision.choice) return fmt::format("{}: {} bytes per Gaussian", decision.model, m.plain_bytes);
    const AppearanceTrial &chosen = m.trials[decision.choice->chosen], &best = m.trials[decision.choice->best];
    return fmt::format("{}: {} bytes per Gaussian, {:.2f} dB below {}, the best; {} dB are allowed", chosen.model,
                       chosen.bytes, best.psnr - chosen.psnr, best.model, tolerance);
}

std::vector<std::string> lines_of(const AppearanceMeasurements& m, const AppearanceDecision& decision,
                                  double tolerance) {
    const Explained e = explained(m.parts);
    return {fmt::format("{} of {} training views held out; {} trained for {} iterations at {}x{}; {:.1f} s in all",
                        m.num_held_out, m.num_views, m.plain_model, m.warm_up_iterations, m.image_width, m.image_height,
                        m.seconds),
            fmt::format("of the error without view dependence {:.1f} % is explained by direction ({:.1f} % on held-out "
                        "views), {:.1f} % by photometric change of "
                        "whole images, {:.1f} % by neither",
                        100 * e.direction, 100 * e.direction_held_out, 100 * e.photometric, 100 * e.neither),
            fmt::format("what is left is {}", cause_text(decision.remaining).words), trials_text(m, tolerance),
            choice_text(m, decision, tolerance)};
}

Json number(double v) { return std::isfinite(v) ? Json(v) : Json(nullptr); }

Json trials_json(const std::vector<AppearanceTrial>& trials) {
    Json json = Json::array();
    for (const AppearanceTrial& t : trials)
        json.push_back({{"model", t.model},
                        {"bytes_per_gaussian", t.bytes},
                        {"iteration_seconds", t.seconds},
                        {"PSNR", number(t.psnr)}});
    return json;
}

Json json_of(const AppearanceMeasurements& m, const AppearanceDecision& decision, double tolerance,
             const std::vector<std::string>& lines) {
    const Explained e = explained(m.parts);
    return {{"model", decision.model},
            {"tolerance", tolerance},
            {"held_out_views", m.num_held_out},
            {"image_size", {m.image_width, m.image_height}},
            {"warm_up_iterations", m.warm_up_iterations},
            {"trial_iterations", m.trial_iterations},
            {"explained",
             {{"direction", e.direction},
              {"photometric", e.photometric},
              {"neither", e.neither},
              {"direction_held_out", e.direction_held_out}}},
            {"direction_worth_dB", number(gain_in_decibels(m.parts.direction))},
            {"remainder", cause_text(decision.remaining).name},
            {"trials", trials_json(m.trials)},
            {"no_time_for", m.unfinished},
            {"lines", lines},
            {"seconds", m.seconds}};
}

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

std::string obstacle_text(const AppearanceMeasurements& m) {
    const char* sides = m.one_sided ? ", and all cameras look nearly the same way" : "";
    if (*m.obstacle == Obstacle::kMasks) return "masks leave nothing of the views that models would be compared on";
    if (*m.obstacle == Obstacle::kLate)
        return fmt::format("too short to tell: no trial ended within a tenth of the time limit{}", sides);
    if (*m.obstacle == Obstacle::kShort)
        return fmt::format("too short to tell: a trial would have {} iterations, and {} are needed{}",
                           m.trial_iterations, kFewestTrialIterations, sides);
    return fmt::format(
        "of {} training views none can be held out ({} are needed), and only these could show that direction matters",
        m.num_views, kFewestViews);
}

AppearanceReport describe_appearance(const AppearanceMeasurements& measured, const AppearanceDecision& decision,
                                     double tolerance) {
    AppearanceReport report{decision.model, {}, {}};
    if (measured.obstacle) {
        report.lines = {decision.model + ": " + obstacle_text(measured)};
        report.json = {{"model", decision.model}, {"lines", report.lines}, {"seconds", measured.seconds}};
        return report;
    }
    report.lines = lines_of(measured, decision, tolerance);
    report.json = json_of(measured, decision, tolerance, report.lines);
    return report;
}

}  // namespace gs
