// SPDX-License-Identifier: Apache-2.0
#include "eval/find_appearance.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>

#include "appearance/model_info.h"
#include "eval/held_out.h"
#include "kernels/core/parallel.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/rehearsal.h"
#include "lib/train/trainer.h"

namespace gs {
namespace {

/// Every n-th training view is held out, beginning in the middle of the first n; and the fewest views of which some can be spared.
constexpr std::size_t kHeldOutEvery = 8, kFewestViews = 8;
/// Shares of options.iterations: of the training without view dependence that all trials begin from, and of each trial. With six models, the
/// dearest at 1.5 times the time of the cheapest, that is below 0.45 of a run.
constexpr double kWarmUpShare = 0.1, kTrialShare = 0.05;
/// Largest share of the time of the run that is to follow, at the time of an iteration that the chosen model's trial took: a run's have more Gaussians.
constexpr double kTimeShare = 0.5;

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

std::int64_t iterations_of(const TrainOptions& options, double share) { return std::max<std::int64_t>(1, std::llround(share * double(options.iterations))); }

struct Split {
    Scene scene;  ///< without the views held out
    std::vector<View> held_out, seen;  ///< as many of each
};

Split split_views(const Scene& scene) {
    Split split{scene, {}, {}};
    split.scene.train.clear(), split.scene.test.clear();
    std::vector<View>& rest = split.scene.train;
    for (std::size_t k = 0; k < scene.train.size(); ++k) (k % kHeldOutEvery == kHeldOutEvery / 2 ? split.held_out : rest).push_back(scene.train[k]);
    for (std::size_t k = 0; k < split.held_out.size(); ++k) split.seen.push_back(rest[k * rest.size() / split.held_out.size()]);
    return split;
}

std::int64_t bytes_of(const AppearanceSpec& spec) {
    return std::int64_t(sizeof(float)) * (group_width(Group::kBase, spec) + group_width(Group::kResidual, spec));
}

/// From the fewest bytes on; `none` first.
std::vector<AppearanceSpec> candidates(TrainOptions options) {
    std::vector<AppearanceSpec> specs;
    for (const ModelInfo* model : appearance_models()) {
        options.appearance = model->name;
        const AppearanceSpec spec = appearance_spec(options);
        if (!model->variant && (model->name == "none" || group_width(Group::kResidual, spec) > 0)) specs.push_back(spec);
    }
    std::stable_sort(specs.begin(), specs.end(), [](const AppearanceSpec& a, const AppearanceSpec& b) { return bytes_of(a) < bytes_of(b); });
    return specs;
}

/// What is left after the best model, in words with figures.
std::string words(const AppearanceChoice& c) {
    const std::string gains = fmt::format("the model gains {:.2f} dB on views it was trained on, and {:.2f} dB on held-out ones", c.train_gain, c.held_out_gain);
    switch (c.remainder) {
        case Remainder::kReflectance: return fmt::format("reflectance: {}", gains);
        case Remainder::kPhotometric:
            return fmt::format("photometric: whole images differ in exposure or colour, which --ppisp on corrects and no appearance explains; {}", gains);
        case Remainder::kInconsistency:
            return fmt::format("inconsistency between images (things that moved, changing light), not reflectance: {}", gains);
        case Remainder::kUnresolved: break;
    }
    return fmt::format("detail that a short training does not reach, with no sign of view dependence: {}", gains);
}

const char* name(Remainder r) {
    switch (r) {
        case Remainder::kReflectance: return "reflectance";
        case Remainder::kPhotometric: return "photometric";
        case Remainder::kInconsistency: return "inconsistency";
        case Remainder::kUnresolved: break;
    }
    return "unresolved";
}

/// Trains and measures until all models had their trial or the time since `start` is up. `unfinished`: those without a result.
std::vector<AppearanceTrial> run_trials(const TrainOptions& options, const Split& split, double start, std::vector<std::string>& unfinished) {
    TrainOptions rehearsed = options;
    rehearsed.appearance = "none";
    if (options.ppisp == "auto") rehearsed.ppisp = "on"; // harmless where images do not differ, and there is no time to find out
    Rehearsal rehearsal(rehearsed, split.scene);
    const Gaussians begun = rehearsal.begin(iterations_of(options, kWarmUpShare)).backend->download(false);
    const std::int64_t iterations = iterations_of(options, kTrialShare);
    std::vector<AppearanceTrial> trials;
    double last = 0, last_measuring = 0; // seconds of the trial before, and of its comparison with photographs
    for (const AppearanceSpec& spec : candidates(options)) {
        const double trial_start = now();
        // The first trial ends in any case: without it there is nothing to choose from.
        double left = std::numeric_limits<double>::infinity();
        if (!trials.empty()) {
            const double iteration = trials[choose_appearance(trials, options.auto_tolerance).chosen].seconds;
            left = start + kTimeShare * double(options.iterations) * iteration - trial_start;
        }
        std::optional<Rehearsed> r;
        if (last <= left) r = rehearsal.go_on(begun, spec, iterations, left - last_measuring); // later models are not faster
        if (!r) {
            unfinished.push_back(spec.model);
            continue;
        }
        const double training = now() - trial_start;
        const ViewErrors held_out = view_errors(*r->backend, split.held_out, rehearsal.background());
        const ViewErrors seen = view_errors(*r->backend, split.seen, rehearsal.background());
        AppearanceTrial trial{spec.model, bytes_of(spec), r->seconds / double(iterations), held_out.psnr, seen.psnr, held_out.error,
                              held_out.aligned_error};
        // Held-out views have no exposure of their own: what the correction will take care of is not counted.
        if (rehearsed.ppisp == "on") trial.psnr = held_out.aligned_psnr, trial.train_psnr = seen.aligned_psnr, trial.error = held_out.aligned_error;
        trials.push_back(trial);
        last = now() - trial_start, last_measuring = last - training;
    }
    return trials;
}

nlohmann::ordered_json json_of(const AppearanceTrial& t) {
    const auto number = [](double v) { return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr); };
    return {{"model", t.model},           {"bytes_per_gaussian", t.bytes}, {"iteration_seconds", t.seconds},        {"PSNR", number(t.psnr)},
            {"train_PSNR", number(t.train_psnr)}, {"error", number(t.error)},      {"aligned_error", number(t.aligned_error)}};
}

AppearanceReport too_few_views(const Scene& scene) {
    AppearanceReport report{"none", {}, {}};
    report.lines = {fmt::format("none: of {} training views none can be held out ({} are needed), and only these could show that direction matters",
                                scene.train.size(), kFewestViews)};
    report.json = {{"model", "none"}, {"reason", report.lines.front()}, {"seconds", 0.0}};
    return report;
}

}  // namespace

AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene) {
    if (scene.train.size() < kFewestViews) return too_few_views(scene);
    const double start = now();
    set_num_threads(options.threads);
    const Split split = split_views(scene);
    std::vector<std::string> unfinished;
    const std::vector<AppearanceTrial> trials = run_trials(options, split, start, unfinished);
    const AppearanceChoice c = choose_appearance(trials, options.auto_tolerance);
    const AppearanceTrial &chosen = trials[c.chosen], &best = trials[c.best];
    const double seconds = now() - start;
    const std::size_t held_out = split.held_out.size();
    const std::int64_t warm_up = iterations_of(options, kWarmUpShare), trial = iterations_of(options, kTrialShare);

    AppearanceReport report;
    report.model = chosen.model;
    std::string scores;
    for (const AppearanceTrial& t : trials) scores += fmt::format("{}{} {:.2f} dB ({} B)", scores.empty() ? "" : ", ", t.model, t.psnr, t.bytes);
    report.lines = {
        fmt::format("{} of {} training views held out; none trained for {} iterations, then each model for {} from there, in {:.1f} s",
                    held_out, scene.train.size(), warm_up, trial, seconds),
        fmt::format("held out: {}{}", scores, unfinished.empty() ? "" : fmt::format("; no time to finish {}", fmt::join(unfinished, ", "))),
        fmt::format("of the error without view dependence {:.0f} % is explained by direction ({}), {:.0f} % by photometric change of whole images, "
                    "{:.0f} % by neither", 100 * c.direction, best.model, 100 * c.photometric, 100 * c.neither),
        fmt::format("what is left is {}", words(c)),
        fmt::format("{}: {} bytes per Gaussian, {:.2f} dB below {}, the best; {} dB are allowed", chosen.model, chosen.bytes, best.psnr - chosen.psnr,
                    best.model, options.auto_tolerance)};
    report.json = {{"model", chosen.model},
                   {"best", best.model},
                   {"tolerance", options.auto_tolerance},
                   {"held_out_views", held_out},
                   {"warm_up_iterations", warm_up},
                   {"trial_iterations", trial},
                   {"explained", {{"direction", c.direction}, {"photometric", c.photometric}, {"neither", c.neither}}},
                   {"remainder", name(c.remainder)},
                   {"train_gain", c.train_gain},
                   {"held_out_gain", c.held_out_gain},
                   {"trials", nlohmann::ordered_json::array()},
                   {"no_time_for", unfinished},
                   {"lines", report.lines},
                   {"seconds", seconds}};
    for (const AppearanceTrial& t : trials) report.json["trials"].push_back(json_of(t));
    return report;
}

}  // namespace gs
