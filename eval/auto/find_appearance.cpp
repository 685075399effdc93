// SPDX-License-Identifier: Apache-2.0
// Runs the search: a smaller scene without the held-out views, a training without view dependence, trials, the report.
#include "eval/auto/find_appearance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "appearance/model_info.h"
#include "eval/auto/photograph.h"
#include "eval/auto/residual_parts.h"
#include "eval/auto/stage.h"
#include "kernels/base/clock.h"
#include "kernels/base/parallel.h"
#include "lib/core/quantities.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/frame.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"
#include "lib/train/trial_training.h"

namespace gs {
namespace {

/// Shares of options.iterations for the training without view dependence, from which all trials start, and for each
/// trial.
constexpr double kWarmUpShare = 1.0 / 15, kTrialShare = 1.0 / 15;
/// Largest share of the following run's time for the measurements.
constexpr double kTimeShare = 0.5;

/// Length of the cameras' mean axis above which they look in nearly the same direction, as in forward-facing scenes.
/// fern's is 0.994, lego's 0.57, and that of cameras within 20 degrees of one axis 0.97.
constexpr double kOneSided = 0.98;

std::int64_t bytes_of(const AppearanceSpec& spec) {
    return std::int64_t(sizeof(float)) * (group_width(Group::kBase, spec) + group_width(Group::kResidual, spec));
}

/// Returns the models to try, in ascending order of bytes; `none` first.
std::vector<AppearanceSpec> candidates(TrainOptions options) {
    std::vector<AppearanceSpec> specs;
    for (const ModelInfo* model : appearance_models()) {
        options.appearance = model->name;
        const AppearanceSpec spec = appearance_spec(options);
        if (!model->variant && (model->name == plain_model() || group_width(Group::kResidual, spec) > 0))
            specs.push_back(spec);
    }
    std::stable_sort(specs.begin(), specs.end(),
                     [](const AppearanceSpec& a, const AppearanceSpec& b) { return bytes_of(a) < bytes_of(b); });
    return specs;
}

struct Trials {
    std::vector<AppearanceTrial> finished;
    std::vector<std::string> unfinished;
};

/// Returns the estimated ratio of the time of an iteration of the run to that of a trial, from their pixels and
/// Gaussians. The estimate is below measurements on a GPU, where much of an iteration does not depend on these: 1.7 on
/// builtin:glossy (measured 1.9), 1.9 on lego (2.2).
double slowdown(const TrainOptions& run, const Stage& stage, std::int64_t gaussians) {
    const double growth =
        run.strategy == Strategy::kNone ? 1 : double(run.cap_max) / double(std::max<std::int64_t>(gaussians, 1));
    return std::pow(std::max(1.0, growth) / stage.pixels, 0.25);
}

/// End of the measurements, on the clock of seconds_now().
struct Deadline {
    double start = 0;
    double limit = 0;   ///< time allowed by a time limit, seconds; 0 = no limit
    double slower = 1;  ///< ratio of the run's time per iteration to a trial's

    /// Returns the seconds left, given the run's iterations and the time per iteration in the trial of the model chosen
    /// so far. Without a limit and without a trial the time is unlimited, because there is nothing to choose from yet.
    double left(std::int64_t iterations, std::optional<double> iteration) const {
        if (limit > 0) return start + limit - seconds_now();
        if (!iteration) return std::numeric_limits<double>::infinity();
        return start + kTimeShare * double(iterations) * slower * *iteration - seconds_now();
    }
};

/// Trains and measures until all models have had their trial or the time is up.
Trials run_trials(TrialTraining& trial, const Gaussians& begun, const Stage& stage,
                  const std::vector<Photograph>& held_out, const Deadline& deadline) {
    const TrainOptions& options = stage.options;
    const std::int64_t iterations = iterations_of(options, kTrialShare);
    Trials trials;
    double last = 0;  // duration of the previous trial, s
    for (const AppearanceSpec& spec : candidates(options)) {
        const double trial_start = seconds_now();
        std::optional<double> iteration;
        if (!trials.finished.empty())
            iteration = trials.finished[choose_appearance(trials.finished, options.auto_tolerance).chosen].seconds;
        const double left = deadline.left(options.iterations, iteration);
        std::optional<TrialResult> r;
        TrainOptions tried = options;
        tried.appearance = spec.model;
        if (last <= left) r = trial.continue_with(begun, tried, iterations, left);  // later models are not faster
        if (!r) {
            trials.unfinished.push_back(spec.model);
            continue;
        }
        // Held-out views have no exposure of their own: errors that the correction will remove are not counted.
        const double psnr = mean_psnr(*r->backend, held_out, trial.background(), options.ppisp == PpispMode::kOn);
        trials.finished.push_back({spec.model, bytes_of(spec), r->seconds / double(iterations), psnr});
        last = seconds_now() - trial_start;
    }
    return trials;
}

}  // namespace

AppearanceMeasurements measure_appearances(const TrainOptions& options, const Scene& scene, bool with_trials) {
    AppearanceMeasurements measured;
    measured.num_views = scene.train.size();
    measured.one_sided = mean_axis(scene.train).norm() > kOneSided;
    measured.plain_model = plain_model();
    if (scene.train.size() < kFewestViews) {
        measured.obstacle = Obstacle::kFewViews;
        return measured;
    }
    Deadline deadline{seconds_now()};
    set_num_threads(options.threads);
    Stage stage = make_stage(options, scene);
    if (options.time_limit) {
        deadline.limit = kLimitShare * options.time_limit->seconds;
        stage.options.time_limit.reset();
        stage.options.iterations = std::llround(
            double(affordable_iterations(stage, deadline.left(0, {}), 1 + candidates(stage.options).size())) /
            kTrialShare);
    }
    measured.warm_up_iterations = iterations_of(stage.options, kWarmUpShare),
    measured.trial_iterations = iterations_of(stage.options, kTrialShare);
    if (measured.trial_iterations < kFewestTrialIterations) {
        measured.obstacle = Obstacle::kShort;
        measured.seconds = seconds_now() - deadline.start;
        return measured;
    }
    TrialTraining trial(stage.options, stage.scene);
    measured.plain_bytes = bytes_of(appearance_spec(stage.options));
    measured.image_width = stage.scene.train.front().camera.width,
    measured.image_height = stage.scene.train.front().camera.height;
    const TrialResult plain = trial.begin(stage.options, measured.warm_up_iterations);
    const std::vector<Photograph> seen =
        load_photographs(stage.scene.train, trial.background(), [&](std::size_t k) { return trial.image(k); });
    const std::vector<Photograph> held_out = load_photographs(stage.scene.test, trial.background());
    measured.num_held_out = held_out.size();
    if (seen.empty() || held_out.empty()) {
        measured.obstacle = Obstacle::kMasks;
        measured.seconds = seconds_now() - deadline.start;
        return measured;
    }
    const auto positions = make_backend(options.device, plain_sh_appearance(0), engine_options(options));
    measured.parts = residual_parts(*plain.backend, *positions, seen, held_out, trial.background());
    if (with_trials && needs_trials(measured.parts, options.auto_tolerance)) {
        deadline.slower = slowdown(options, stage, plain.backend->count());
        Trials trials = run_trials(trial, plain.backend->download(false), stage, held_out, deadline);
        measured.trials = std::move(trials.finished), measured.unfinished = std::move(trials.unfinished);
        if (measured.trials.empty()) measured.obstacle = Obstacle::kLate;
    }
    measured.seconds = seconds_now() - deadline.start;
    return measured;
}

AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene) {
    const AppearanceMeasurements measured = measure_appearances(options, scene);
    return describe_appearance(measured, decide_appearance(measured, options.auto_tolerance), options.auto_tolerance);
}

DirectionTest test_direction(const TrainOptions& options, const Scene& scene) {
    const AppearanceMeasurements measured = measure_appearances(options, scene, false);
    if (measured.obstacle) return {false, obstacle_text(measured)};
    return {!needs_trials(measured.parts, options.auto_tolerance), ""};
}

}  // namespace gs
