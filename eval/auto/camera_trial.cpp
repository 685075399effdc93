// SPDX-License-Identifier: Apache-2.0
// Runs the two trainings, aligns the held-out views to each, and decides.
#include "eval/auto/camera_trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "eval/auto/appearance_choice.h"
#include "eval/auto/photograph.h"
#include "eval/auto/stage.h"
#include "kernels/base/clock.h"
#include "kernels/base/parallel.h"
#include "lib/train/align_cameras.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/trial_training.h"

namespace gs {
namespace {

/// Share of options.iterations for each of the two trainings.
constexpr double kShare = 1.0 / 10;
/// Fewest iterations for each training image in which its camera can learn.
constexpr double kFewestRounds = 10;

/// Returns the number of steps of each held-out view's camera towards a model. Few views get more, because one that
/// does not arrive counts for much.
int align_steps(std::size_t num_views) { return int(std::clamp<std::size_t>(1920 / num_views, 60, 120)); }

double mean(const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / double(values.size());
}

/// The mean of differences between pairs, and its standard error.
struct Gain {
    double mean = 0, error = 0;
};

Gain gain_of(std::vector<double> from, const std::vector<double>& to) {
    const double count = double(from.size());
    for (std::size_t k = 0; k < from.size(); ++k) from[k] = to[k] - from[k];
    Gain out{mean(from)};
    double squares = 0;
    for (const double gain : from) squares += (gain - out.mean) * (gain - out.mean);
    if (count > 1) out.error = std::sqrt(squares / (count * (count - 1)));
    return out;
}

}  // namespace

CameraTrial try_cameras(const TrainOptions& options, const Scene& scene) {
    CameraTrial out;
    const double start = seconds_now();
    const auto without_result = [&](std::string obstacle) {
        out.obstacle = std::move(obstacle), out.seconds = seconds_now() - start;
        return out;
    };
    if (scene.train.size() < 2 * kFewestViews)
        return without_result(fmt::format("{} training views are too few to hold some out; {} are needed",
                                          scene.train.size(), 2 * kFewestViews));
    set_num_threads(options.threads);
    Stage stage = make_stage(options, scene);
    stage.options.appearance = options.appearance;
    stage.options.schedule = ScheduleKind::kProgress;  // a short training has all of its parts
    out.iterations = iterations_of(options, kShare);
    if (options.time_limit) {
        const auto num_views = stage.scene.test.size();
        const std::int64_t aligning = align_steps(num_views) * std::int64_t(num_views);
        out.iterations = affordable_iterations(stage, kLimitShare * options.time_limit->seconds, 2) - aligning;
        stage.options.time_limit.reset();
    }
    const double needed = std::max(double(kFewestTrialIterations), kFewestRounds * double(stage.scene.train.size()));
    if (double(out.iterations) < needed)
        return without_result(fmt::format("too short to tell: a trial would have {} iterations, and {:.0f} are needed",
                                          std::max<std::int64_t>(0, out.iterations), needed));
    stage.options.iterations = out.iterations;
    TrialTraining trial(stage.options, stage.scene);
    for (View& view : stage.scene.test) view.decoded = view_image(view);
    std::erase_if(stage.scene.test,
                  [&](const View& view) { return load_photographs({view}, trial.background()).empty(); });
    if (stage.scene.test.empty())
        return without_result("masks leave nothing of the views that cameras would be compared on");
    const int steps = align_steps(stage.scene.test.size());
    const auto scores = [&](CameraRefinement* cameras) -> CameraTrial::Scores {
        const TrialResult trained = trial.begin(out.iterations, cameras);
        const AlignedViews aligned = align_cameras(*trained.backend, stage.scene.test, trial.background(), steps);
        return {psnrs(*trained.backend, load_photographs(aligned.views, trial.background()), trial.background(),
                      stage.options.ppisp == PpispMode::kOn),
                aligned.ssim};
    };
    out.given = scores(nullptr);
    TrainOptions learning = stage.options;
    learning.refine_cameras = RefineCameras::kOn;
    CameraRefinement cameras(learning, stage.scene);
    out.learned = scores(&cameras);
    out.median_pixels = cameras.corrections().median / std::sqrt(stage.pixels);
    out.seconds = seconds_now() - start;
    return out;
}

CameraDecision decide_cameras(const CameraTrial& trial) {
    CameraDecision out;
    if (!trial.obstacle.empty()) {
        out.reason = "off: " + trial.obstacle;
        return out;
    }
    const Gain ssim = gain_of(trial.given.ssim, trial.learned.ssim);
    const double missing = std::max(1e-6, 1 - mean(trial.given.ssim));
    out.decibels = gain_of(trial.given.psnr, trial.learned.psnr).mean;
    out.gain = ssim.mean / missing, out.error = ssim.error / missing;
    out.learn = out.gain > std::max(kLeastCameraGain, 2 * out.error) && out.decibels > 0;
    out.reason = fmt::format(
        "{}: corrections of {:.2f} pixels in the median, and {} held-out views, aligned to each model, gain {:+.2f} dB "
        "and {:+.1f} % of what SSIM lacks to 1 (standard error {:.1f}, asked for {:g})",
        out.learn ? "on" : "off", trial.median_pixels, trial.given.ssim.size(), out.decibels, 100 * out.gain,
        100 * out.error, 100 * kLeastCameraGain);
    return out;
}

nlohmann::ordered_json event_of(const CameraTrial& trial, const CameraDecision& decision) {
    nlohmann::ordered_json event = {{"event", "refine_cameras"}, {"on", decision.learn}};
    if (trial.obstacle.empty())
        event.update({{"gain", decision.gain},
                      {"standard_error", decision.error},
                      {"decibels", decision.decibels},
                      {"median_pixels", trial.median_pixels},
                      {"iterations", trial.iterations}});
    event["reason"] = decision.reason, event["seconds"] = trial.seconds;
    return event;
}

}  // namespace gs
