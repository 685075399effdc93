// SPDX-License-Identifier: Apache-2.0
// The stages of the search: a smaller scene, a training without view dependence, trials, the report.
#include "eval/auto/find_appearance.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "appearance/model_info.h"
#include "eval/auto/appearance_choice.h"
#include "eval/auto/photograph.h"
#include "eval/auto/residual_parts.h"
#include "kernels/core/clock.h"
#include "kernels/core/parallel.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/resized.h"
#include "lib/train/choose_backend.h"
#include "lib/train/rehearsal.h"

namespace gs {
namespace {

/// Every n-th training view is held out, beginning in the middle of the first n; and the fewest views of which some can be spared.
constexpr std::size_t kHeldOutEvery = 8, kFewestViews = 8;
/// Wider images are made smaller, and cap_max as pixels are fewer: models part sooner, in a fraction of the time. (On lego sv, its best model, led sh by 0.22 dB
/// after 2000 and 2000 iterations at 400 pixels, and by 0.07 after 3000 and 1500 at 800 pixels with three times the Gaussians.)
constexpr int kStageWidth = 400;
/// Shares of options.iterations: of the training without view dependence that all trials begin from, and of each trial.
constexpr double kWarmUpShare = 1.0 / 15, kTrialShare = 1.0 / 15;
/// Largest share of the time of the run that is to follow.
constexpr double kTimeShare = 0.5;

std::int64_t iterations_of(const TrainOptions& options, double share) { return std::max<std::int64_t>(1, std::llround(share * double(options.iterations))); }

/// A smaller scene without the views held out.
struct Stage {
    Scene scene;
    std::vector<View> held_out;
    TrainOptions options;
    double pixels = 1;  ///< share of the pixels of the scene's images
};

/// The model whose Gaussians show one colour in every direction.
std::string plain_model() { return plain_sh_appearance(0).model; }

Stage make_stage(const TrainOptions& options, const Scene& scene) {
    Stage stage{scene, {}, options, 1};
    stage.scene.train.clear(), stage.scene.test.clear();
    const auto pixels = [](const View& view) { return double(view.camera.width) * view.camera.height; };
    double small = 0, full = 0;
    for (std::size_t k = 0; k < scene.train.size(); ++k) {
        View view = smaller_view(scene.train[k], kStageWidth);
        small += pixels(view), full += pixels(scene.train[k]);
        (k % kHeldOutEvery == kHeldOutEvery / 2 ? stage.held_out : stage.scene.train).push_back(std::move(view));
    }
    stage.pixels = small / full;
    stage.options.appearance = plain_model();
    stage.options.cap_max = std::max<std::int64_t>(1, std::llround(double(options.cap_max) * stage.pixels));
    if (options.ppisp == PpispMode::kAuto) stage.options.ppisp = PpispMode::kOn; // harmless where images do not differ, and there is no time to find out
    return stage;
}

std::int64_t bytes_of(const AppearanceSpec& spec) {
    return std::int64_t(sizeof(float)) * (group_width(Group::kBase, spec) + group_width(Group::kResidual, spec));
}

/// From the fewest bytes on; plain_model() first.
std::vector<AppearanceSpec> candidates(TrainOptions options) {
    std::vector<AppearanceSpec> specs;
    for (const ModelInfo* model : appearance_models()) {
        options.appearance = model->name;
        const AppearanceSpec spec = appearance_spec(options);
        if (!model->variant && (model->name == plain_model() || group_width(Group::kResidual, spec) > 0)) specs.push_back(spec);
    }
    std::stable_sort(specs.begin(), specs.end(), [](const AppearanceSpec& a, const AppearanceSpec& b) { return bytes_of(a) < bytes_of(b); });
    return specs;
}

/// In one word for programs, and in some for people.
struct Verdict {
    const char *name, *words;
};

Verdict verdict(RemainingError r) {
    switch (r) {
        case RemainingError::kReflectance: return {"reflectance", "reflectance"};
        case RemainingError::kPhotometric:
            return {"photometric", "photometric: whole images differ in exposure or colour, which no appearance explains and --ppisp is for"};
        case RemainingError::kInconsistency:
            return {"inconsistency", "inconsistency between images (things that moved, changing light), not reflectance"};
        case RemainingError::kUnresolved: break;
    }
    return {"unresolved", "detail that a short training does not reach; less of it depends on the direction than is allowed"};
}

struct Trials {
    std::vector<AppearanceTrial> finished;
    std::vector<std::string> unfinished;
};

/// How much longer an iteration of the run will take than one of a trial, for its pixels and Gaussians. Not more than was seen on a GPU, where much of an
/// iteration does not depend on them: 1.7 on builtin:glossy (measured 1.9), 1.9 on lego (2.2).
double slowdown(const TrainOptions& run, const Stage& stage, std::int64_t gaussians) {
    const double growth = run.strategy == Strategy::kNone ? 1 : double(run.cap_max) / double(std::max<std::int64_t>(gaussians, 1));
    return std::pow(std::max(1.0, growth) / stage.pixels, 0.25);
}

/// Trains and measures until all models had their trial or the time since `start` is up: kTimeShare of a run of the model chosen so far, whose
/// iterations are `slower` by that factor.
Trials run_trials(Rehearsal& rehearsal, const Gaussians& begun, const Stage& stage, const std::vector<Photograph>& held_out, double start, double slower) {
    const TrainOptions& options = stage.options;
    const std::int64_t iterations = iterations_of(options, kTrialShare);
    Trials trials;
    double last = 0; // seconds of the trial before
    for (const AppearanceSpec& spec : candidates(options)) {
        const double trial_start = seconds_now();
        // The first trial ends in any case: without it there is nothing to choose from.
        double left = std::numeric_limits<double>::infinity();
        if (!trials.finished.empty()) {
            const double iteration = trials.finished[choose_appearance(trials.finished, options.auto_tolerance).chosen].seconds;
            left = start + kTimeShare * double(options.iterations) * slower * iteration - trial_start;
        }
        std::optional<Rehearsed> r;
        if (last <= left) r = rehearsal.continue_with(begun, spec, iterations, left); // later models are not faster
        if (!r) {
            trials.unfinished.push_back(spec.model);
            continue;
        }
        // Held-out views have no exposure of their own: what the correction will take care of is not counted.
        const double psnr = mean_psnr(*r->backend, held_out, rehearsal.background(), options.ppisp == PpispMode::kOn);
        trials.finished.push_back({spec.model, bytes_of(spec), r->seconds / double(iterations), psnr});
        last = seconds_now() - trial_start;
    }
    return trials;
}

nlohmann::ordered_json number(double v) { return std::isfinite(v) ? nlohmann::ordered_json(v) : nlohmann::ordered_json(nullptr); }

AppearanceReport nothing_to_go_by(const std::string& why, double seconds) {
    AppearanceReport report{plain_model(), {plain_model() + ": " + why}, {}};
    report.json = {{"model", report.model}, {"lines", report.lines}, {"seconds", seconds}};
    return report;
}

}  // namespace

AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene) {
    if (scene.train.size() < kFewestViews)
        return nothing_to_go_by(fmt::format("of {} training views none can be held out ({} are needed), and only these could show that direction matters",
                                            scene.train.size(), kFewestViews), 0);
    const double start = seconds_now();
    set_num_threads(options.threads);
    const Stage stage = make_stage(options, scene);
    Rehearsal rehearsal(stage.options, stage.scene);
    const std::int64_t warm_up = iterations_of(options, kWarmUpShare), trial = iterations_of(options, kTrialShare);
    const Rehearsed plain = rehearsal.begin(warm_up);
    const std::vector<Photograph> seen = load_photographs(stage.scene.train, rehearsal.background(), [&](std::size_t k) { return rehearsal.image(k); });
    const std::vector<Photograph> held_out = load_photographs(stage.held_out, rehearsal.background());
    if (seen.empty() || held_out.empty()) return nothing_to_go_by("masks leave nothing of the views that models would be compared on", seconds_now() - start);
    const ResidualParts parts = residual_parts(*plain.backend, *make_backend(options.device, plain_sh_appearance(0), backend_options(options)), seen,
                                               held_out, rehearsal.background());
    const Verdict left = verdict(classify_remaining_error(parts, options.auto_tolerance));

    AppearanceReport report;
    report.model = plain_model();
    Trials trials;
    std::string found = fmt::format("no model was tried: direction is worth {:.2f} dB, and {} dB are allowed", gain_in_decibels(parts.direction), options.auto_tolerance);
    std::string chosen = fmt::format("{}: {} bytes per Gaussian", report.model, bytes_of(appearance_spec(stage.options)));
    if (gain_in_decibels(parts.direction) > options.auto_tolerance) {
        trials = run_trials(rehearsal, plain.backend->download(false), stage, held_out, start, slowdown(options, stage, plain.backend->count()));
        const AppearanceChoice c = choose_appearance(trials.finished, options.auto_tolerance);
        const AppearanceTrial &kept = trials.finished[c.chosen], &best = trials.finished[c.best];
        report.model = kept.model;
        found = fmt::format("held out after {} iterations of each:", trial);
        for (const AppearanceTrial& t : trials.finished) found += fmt::format("{} {} {:.2f} dB ({} B)", &t == &trials.finished.front() ? "" : ",", t.model, t.psnr, t.bytes);
        if (!trials.unfinished.empty()) found += fmt::format("; no time to finish {}", fmt::join(trials.unfinished, ", "));
        chosen = fmt::format("{}: {} bytes per Gaussian, {:.2f} dB below {}, the best; {} dB are allowed", kept.model, kept.bytes, best.psnr - kept.psnr,
                             best.model, options.auto_tolerance);
    }
    const double seconds = seconds_now() - start, direction = (1 - parts.photometric) * std::max(parts.direction, 0.0);
    const Camera& camera = stage.scene.train.front().camera;
    report.lines = {
        fmt::format("{} of {} training views held out; {} trained for {} iterations at {}x{}; {:.1f} s in all", held_out.size(), scene.train.size(), plain_model(), warm_up,
                    camera.width, camera.height, seconds),
        fmt::format("of the error without view dependence {:.1f} % is explained by direction ({:.1f} % on held-out views), {:.1f} % by photometric change of "
                    "whole images, {:.1f} % by neither", 100 * direction, 100 * (1 - parts.photometric) * parts.held_out_direction, 100 * parts.photometric,
                    100 * (1 - parts.photometric - direction)),
        fmt::format("what is left is {}", left.words), found, chosen};
    report.json = {{"model", report.model},
                   {"tolerance", options.auto_tolerance},
                   {"held_out_views", held_out.size()},
                   {"image_size", {camera.width, camera.height}},
                   {"warm_up_iterations", warm_up},
                   {"trial_iterations", trial},
                   {"explained", {{"direction", direction}, {"photometric", parts.photometric}, {"neither", 1 - parts.photometric - direction},
                                  {"direction_held_out", (1 - parts.photometric) * parts.held_out_direction}}},
                   {"direction_worth_dB", number(gain_in_decibels(parts.direction))},
                   {"remainder", left.name},
                   {"trials", nlohmann::ordered_json::array()},
                   {"no_time_for", trials.unfinished},
                   {"lines", report.lines},
                   {"seconds", seconds}};
    for (const AppearanceTrial& t : trials.finished)
        report.json["trials"].push_back({{"model", t.model}, {"bytes_per_gaussian", t.bytes}, {"iteration_seconds", t.seconds}, {"PSNR", number(t.psnr)}});
    return report;
}

}  // namespace gs
