// SPDX-License-Identifier: Apache-2.0
// Trains on the smaller scene with and without each part, scores the held-out views, and decides.
#include "eval/auto/rehearsal.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "eval/auto/appearance_choice.h"
#include "eval/auto/photograph.h"
#include "eval/auto/stage.h"
#include "kernels/base/clock.h"
#include "kernels/base/parallel.h"
#include "lib/train/align_cameras.h"
#include "lib/train/camera_refinement.h"
#include "lib/train/photometric.h"
#include "lib/train/trial_training.h"

namespace gs {
namespace {

/// Share of options.iterations for each training with and without learned cameras.
constexpr double kCameraShare = 1.0 / 10;
/// Shares of options.iterations for the training that both trainings for PPISP continue, and for each of these.
constexpr double kBeforePpispShare = 1.0 / 15, kPpispShare = 1.0 / 15;
/// Length, as such a share, of the schedule of the first training, which stops after two thirds of it.
constexpr double kScheduleShare = 1.0 / 10;
/// Ratio of PPISP's rate to a run's: a trial has fewer steps in which images can be told apart
/// (docs/lab/appearance.md#what---ppisp-auto-decides).
constexpr double kPpispRateFactor = 3;
/// Fewest iterations of a training with or without PPISP, in all and for each training image.
constexpr double kFewestPpispIterations = 250, kFewestPpispRounds = 2;
/// The same for cameras, whose two trainings differ by chance, too.
constexpr double kFewestCameraIterations = kFewestTrialIterations, kFewestCameraRounds = 10;

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

/// The smaller scene, and the trainings on it.
class Rehearsal {
  public:
    Rehearsal(const TrainOptions& options, const Scene& scene, std::size_t parts)
        : run_(options),
          parts_(parts),
          stage_(short_trainings(options, scene)),
          trial_(stage_.options, stage_.scene),
          background_(trial_.background()) {
        std::vector<View>& views = stage_.scene.test;
        for (View& view : views) view.decoded = view_image(view);
        std::erase_if(views, [&](const View& view) { return load_photographs({view}, background_).empty(); });
    }

    PartTrial ppisp() {
        constexpr double kBefore = kBeforePpispShare / kPpispShare;
        PartTrial out{.part = Part::kPpisp, .iterations = iterations(kPpispShare, 2 + kBefore)};
        out.obstacle = obstacle(out, std::max(kFewestPpispIterations, kFewestPpispRounds * num_views()));
        if (!out.obstacle.empty()) return out;
        TrainOptions options = stage_.options;
        options.ppisp = PpispMode::kOff;
        options.appearance = plain_model();
        options.iterations = std::llround(kScheduleShare / kPpispShare * double(out.iterations));
        const std::vector<Photograph> photographs = load_photographs(stage_.scene.test, background_);
        const Gaussians begun =
            trial_.begin(options, std::llround(kBefore * double(out.iterations))).backend->download(false);
        options.appearance = stage_.options.appearance;
        options.ppisp_lr *= kPpispRateFactor;
        for (const PpispMode mode : {PpispMode::kOff, PpispMode::kOn}) {
            options.ppisp = mode;
            const auto trained = trial_.continue_with(begun, options, out.iterations);
            const bool with = mode == PpispMode::kOn;
            (with ? out.with : out.without).psnr = psnrs(*trained->backend, photographs, background_, true);
            if (with) out.correction = exposure_spread(trained->backend->download_ppisp());
        }
        return out;
    }

    PartTrial cameras(PpispMode ppisp) {
        PartTrial out{.part = Part::kCameras, .iterations = iterations(kCameraShare, 2)};
        const std::size_t held_out = stage_.scene.test.size();
        const int steps = align_steps(std::max<std::size_t>(1, held_out));
        if (run_.time_limit) out.iterations -= steps * std::int64_t(held_out);
        out.obstacle = obstacle(out, std::max(kFewestCameraIterations, kFewestCameraRounds * num_views()));
        if (!out.obstacle.empty()) return out;
        TrainOptions options = stage_.options;
        options.ppisp = ppisp;
        options.iterations = out.iterations;
        const auto scores = [&](CameraRefinement* cameras) -> HeldOutScores {
            const TrialResult trained = trial_.begin(options, out.iterations, cameras);
            const AlignedViews aligned = align_cameras(*trained.backend, stage_.scene.test, background_, steps);
            return {psnrs(*trained.backend, load_photographs(aligned.views, background_), background_,
                          ppisp == PpispMode::kOn),
                    aligned.ssim};
        };
        out.without = scores(nullptr);
        TrainOptions learning = options;
        learning.refine_cameras = RefineCameras::kOn;
        CameraRefinement cameras(learning, stage_.scene);
        out.with = scores(&cameras);
        out.correction = cameras.corrections().median / std::sqrt(stage_.pixels);
        return out;
    }

  private:
    static Stage short_trainings(const TrainOptions& options, const Scene& scene) {
        Stage stage = make_stage(options, scene);
        if (options.appearance != kAutoAppearance) stage.options.appearance = options.appearance;
        stage.options.schedule = ScheduleKind::kProgress;  // a short training has all of its parts
        stage.options.time_limit.reset();
        return stage;
    }

    double num_views() const { return double(stage_.scene.train.size()); }

    /// Returns the iterations of a training that has this share of a run, or of one of `trainings` within the part's
    /// share of a time limit.
    std::int64_t iterations(double share, double trainings) const {
        if (!run_.time_limit) return iterations_of(run_, share);
        return affordable_iterations(stage_, kLimitShare * run_.time_limit->seconds / double(parts_), trainings);
    }

    /// Returns why nothing can be measured; empty if it can.
    std::string obstacle(const PartTrial& trial, double needed) const {
        if (double(trial.iterations) < needed)
            return fmt::format("too short to tell: a trial would have {} iterations, and {:.0f} are needed",
                               std::max<std::int64_t>(0, trial.iterations), needed);
        return stage_.scene.test.empty() ? "masks leave nothing of the views that would be compared" : "";
    }

    const TrainOptions run_;
    const std::size_t parts_;
    Stage stage_;
    TrialTraining trial_;
    const Vec3<float> background_;
};

}  // namespace

const char* option_of(Part part) { return part == Part::kPpisp ? "ppisp" : "refine-cameras"; }

void set_part(TrainOptions& options, Part part, bool on) {
    if (part == Part::kCameras) {
        options.refine_cameras = on ? RefineCameras::kOn : RefineCameras::kOff;
        return;
    }
    options.ppisp = on ? PpispMode::kOn : PpispMode::kOff;
    options.ppisp_exif = on && options.ppisp_exif;
}

std::vector<PartTrial> rehearse(TrainOptions& options, const Scene& scene) {
    std::vector<Part> parts;
    if (options.ppisp == PpispMode::kAuto) parts.push_back(Part::kPpisp);
    if (options.refine_cameras == RefineCameras::kAuto) parts.push_back(Part::kCameras);
    if (parts.empty()) return {};
    set_num_threads(options.threads);
    double start = seconds_now();
    std::optional<Rehearsal> rehearsal;
    if (scene.train.size() >= 2 * kFewestViews) rehearsal.emplace(options, scene, parts.size());
    std::vector<PartTrial> out;
    for (const Part part : parts) {
        if (!rehearsal)
            out.push_back({.part = part,
                           .obstacle = fmt::format("{} training views are too few to hold some out; {} are needed",
                                                   scene.train.size(), 2 * kFewestViews)});
        else
            out.push_back(part == Part::kPpisp ? rehearsal->ppisp() : rehearsal->cameras(options.ppisp));
        const double now = seconds_now();
        out.back().seconds = now - start;
        start = now;
        set_part(options, part, decide(out.back()).on);
    }
    return out;
}

PartDecision decide(const PartTrial& trial) {
    PartDecision out;
    if (!trial.obstacle.empty()) {
        out.reason = "off: " + trial.obstacle;
        return out;
    }
    const Gain psnr = gain_of(trial.without.psnr, trial.with.psnr);
    out.decibels = psnr.mean;
    std::string reason;
    if (trial.part == Part::kPpisp) {
        out.gain = psnr.mean, out.error = psnr.error;
        out.on = out.gain > std::max(kLeastPhotometricGain, out.error);
        reason = fmt::format(
            "{} held-out views, with colours aligned, gain {:+.2f} dB (standard error {:.2f}, required {:g}); "
            "exposures differ by {:.2f} stops",
            trial.with.psnr.size(), out.gain, out.error, kLeastPhotometricGain, trial.correction);
    } else {
        const Gain ssim = gain_of(trial.without.ssim, trial.with.ssim);
        const double missing = std::max(1e-6, 1 - mean(trial.without.ssim));
        out.gain = ssim.mean / missing, out.error = ssim.error / missing;
        out.on = out.gain > std::max(kLeastCameraGain, 2 * out.error) && out.decibels > 0;
        reason = fmt::format(
            "corrections of {:.2f} pixels in the median, and {} held-out views, aligned to each model, gain {:+.2f} dB "
            "and {:+.1f} % of what SSIM lacks to 1 (standard error {:.1f}, required {:g})",
            trial.correction, trial.with.ssim.size(), out.decibels, 100 * out.gain, 100 * out.error,
            100 * kLeastCameraGain);
    }
    out.reason = (out.on ? "on: " : "off: ") + reason;
    return out;
}

nlohmann::ordered_json event_of(const PartTrial& trial, const PartDecision& decision) {
    const bool ppisp = trial.part == Part::kPpisp;
    nlohmann::ordered_json event = {{"event", ppisp ? "photometric" : "refine_cameras"}, {"on", decision.on}};
    if (trial.obstacle.empty()) {
        event.update({{"gain", decision.gain}, {"standard_error", decision.error}});
        if (!ppisp) event["decibels"] = decision.decibels;
        event.update({{ppisp ? "stops" : "median_pixels", trial.correction}, {"iterations", trial.iterations}});
    }
    event["reason"] = decision.reason, event["seconds"] = trial.seconds;
    return event;
}

}  // namespace gs
