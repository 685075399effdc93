// SPDX-License-Identifier: Apache-2.0
// Runs the two trainings, aligns the held-out views to each, and decides.
#include "eval/auto/camera_trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "eval/auto/appearance_choice.h"
#include "eval/auto/photograph.h"
#include "eval/auto/stage.h"
#include "kernels/base/clock.h"
#include "kernels/base/parallel.h"
#include "lib/model/appearance_spec.h"
#include "lib/scene/image_cache.h"
#include "lib/train/align_cameras.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/trial_training.h"

namespace gs {
namespace {

/// Width in pixels to which wider images are reduced.
constexpr int kWidth = 400;
/// Share of options.iterations for each of the three trainings.
constexpr double kShare = 1.0 / 15;
/// Steps of each held-out view's camera towards a model.
constexpr int kAlignSteps = 40;
/// Fewest iterations for each training image in which its camera can learn.
constexpr double kFewestRounds = 4;

}  // namespace

CameraTrial try_cameras(const TrainOptions& options, const Scene& scene) {
    CameraTrial out;
    if (scene.train.size() < 2 * kFewestViews) {
        out.obstacle = fmt::format("{} training views are too few to hold some out; {} are needed", scene.train.size(),
                                   2 * kFewestViews);
        return out;
    }
    const double start = seconds_now();
    set_num_threads(options.threads);
    Stage stage = make_stage(options, scene, kWidth);
    double most_seconds = std::numeric_limits<double>::infinity();
    if (options.time_limit) {
        most_seconds = kLimitShare * options.time_limit->seconds;
        stage.options.time_limit.reset();
        stage.options.iterations = std::llround(double(affordable_iterations(stage, most_seconds, 3)) / kShare);
    }
    out.iterations = iterations_of(stage.options, kShare);
    const double needed =
        std::max(double(kFewestTrialIterations), kFewestRounds * double(stage.scene.train.size()));
    if (double(out.iterations) < needed) {
        out.obstacle = fmt::format("too short to tell: a trial would have {} iterations, and {:.0f} are needed",
                                   out.iterations, needed);
        out.seconds = seconds_now() - start;
        return out;
    }
    const AppearanceSpec appearance = appearance_spec(options);
    const bool aligns_colours = stage.options.ppisp == PpispMode::kOn;
    TrialTraining trial(stage.options, stage.scene);
    ImageCache images(stage.scene.test, std::numeric_limits<std::size_t>::max(), 0);
    const Gaussians state = trial.begin(out.iterations).backend->download(false);
    const auto scores = [&](CameraRefinement* cameras) -> std::vector<double> {
        const double left = start + most_seconds - seconds_now();
        const auto trained = trial.continue_with(state, appearance, out.iterations, left, cameras);
        if (!trained) return {};
        const auto image = [&](std::size_t k) { return images.get(k); };
        const AlignedViews aligned =
            align_cameras(*trained->backend, stage.scene.test, trial.background(), kAlignSteps, image);
        return psnrs(*trained->backend, load_photographs(aligned.views, trial.background(), image), trial.background(),
                     aligns_colours);
    };
    out.given = scores(nullptr);
    TrainOptions learning = stage.options;
    learning.refine_cameras = RefineCameras::kOn;
    CameraRefinement cameras(learning, stage.scene);
    if (!out.given.empty()) out.learned = scores(&cameras);
    out.median_pixels = cameras.corrections().median / std::sqrt(stage.pixels);
    if (out.learned.empty())
        out.obstacle = options.time_limit ? "too short to tell: no trial ended within a tenth of the time limit"
                                          : "masks leave nothing of the views that cameras would be compared on";
    out.seconds = seconds_now() - start;
    return out;
}

CameraDecision decide_cameras(const CameraTrial& trial) {
    CameraDecision out;
    if (!trial.obstacle.empty()) {
        out.reason = "off: " + trial.obstacle;
        return out;
    }
    const double num_views = double(trial.given.size());
    double squares = 0;
    for (std::size_t k = 0; k < trial.given.size(); ++k)
        out.gain += (trial.learned[k] - trial.given[k]) / num_views,
            squares += std::pow(trial.learned[k] - trial.given[k], 2);
    if (num_views > 1)
        out.error = std::sqrt(std::max(0.0, squares / num_views - out.gain * out.gain) / (num_views - 1));
    out.learn = out.gain > std::max(kLeastCameraGain, 2 * out.error);
    out.reason = fmt::format(
        "{}: corrections of {:.2f} pixels in the median, {:+.2f} dB (standard error {:.2f}) on {} held-out views with "
        "their cameras aligned, and {:g} are asked for",
        out.learn ? "on" : "off", trial.median_pixels, out.gain, out.error, trial.given.size(), kLeastCameraGain);
    return out;
}

nlohmann::ordered_json event_of(const CameraTrial& trial, const CameraDecision& decision) {
    nlohmann::ordered_json event = {{"event", "refine_cameras"}, {"on", decision.learn}};
    if (trial.obstacle.empty())
        event.update({{"gain", decision.gain},
                      {"standard_error", decision.error},
                      {"median_pixels", trial.median_pixels},
                      {"given_psnr", trial.given},
                      {"learned_psnr", trial.learned},
                      {"iterations", trial.iterations}});
    event["reason"] = decision.reason, event["seconds"] = trial.seconds;
    return event;
}

}  // namespace gs
