// SPDX-License-Identifier: Apache-2.0
// Combines views, densification, photometric correction and residuals into iterations.
#include "lib/train/step_runner.h"

#include <algorithm>
#include <limits>

#include "kernels/splat/smoothing.h"
#include "lib/scene/camera_params.h"
#include "lib/train/output_schedule.h"

namespace gs {
namespace {

/// The time of scoring the residuals by a view, relative to rendering the view.
constexpr double kWorthPerFrame = 4;
/// The number of iterations after which the 3-D filter follows the moved Gaussians. It is as often as Gaussians appear,
/// which begin with the filter of those that they are copies of.
constexpr std::int64_t kSmoothingInterval = 100;

}  // namespace

StepRunner::StepRunner(const TrainOptions& options, Scene& scene, const AppearanceSpec& appearance, ModelLimits& limits,
                       TrainingSchedule& schedule, Journal& journal)
    : output_(options),
      length_(options),
      antialiasing_(options.antialiasing),
      scene_(scene),
      limits_(limits),
      schedule_(schedule),
      journal_(journal),
      views_(options, scene),
      densification_(options, appearance, scene.extent, options.background.always(0, 0, 0), limits.views()),
      photometric_(options, scene),
      cameras_(options, scene),
      composer_(options, appearance, scene, &photometric_),
      residuals_(options, appearance, scene) {}

Gaussians StepRunner::begin(Gaussians first, bool from_points) {
    if (!from_points) densification_.resume(first.active_degree);
    first.active_degree = densification_.active_degree();
    first.ppisp = photometric_.initial_state();
    start_antialiasing(first);
    return first;
}

Gaussians StepRunner::resume(Gaussians state, const CameraState& cameras) {
    cameras_.resume(cameras);
    photometric_.resume(state, schedule_.moment());
    densification_.resume(state.active_degree);
    start_antialiasing(state);
    return state;
}

/// Makes the model antialiased or not, as the options say. A checkpoint keeps its 3-D filter, so that a resumed run
/// equals one that never stopped.
void StepRunner::start_antialiasing(Gaussians& state) {
    if (antialiasing_ == Antialiasing::kOff || (antialiasing_ == Antialiasing::kAuto && !state.antialiased)) {
        merge_smoothing(state);
        state.antialiased = false;
        return;
    }
    for (const View& view : scene_.train) sharp_cameras_.push_back(camera_params(view.camera));
    if (state[Group::kSmoothing].width == 0) add_smoothing(state, sharp_cameras_);
}

void StepRunner::use(const Backend& backend) {
    views_.set_views_per_step(backend.views_per_step(), [&](int k) { return backend.needs_pixels(k); });
}

void StepRunner::prefetch() { views_.prefetch(schedule_.iteration(), end_of_views(), schedule_.reduction()); }

void StepRunner::take(Backend& backend) {
    // Images come first because reading them may fail: the model is still unchanged then, and a checkpoint continues
    // before this iteration.
    const std::vector<StepView> views = next_views(backend);
    const auto num_views = std::int64_t(views.size());
    const ScheduleMoment moment = schedule_.moment();
    const std::int64_t first = moment.iteration + 1, last = moment.iteration + num_views;
    cameras_.before_step(backend, moment);
    const bool hold = multiples_passed(moment.before, moment.position, kDegreeInterval) > 0 &&
                      photometric_.holds_view_dependence(backend, moment);
    const auto most = [&] { return schedule_.most_gaussians(backend.count(), limits_.most_now(backend)); };
    journal_.write_change(densification_.before_step(backend, moment, hold, most), first);
    if (const auto change = residuals_.before_step(backend, moment, steps_on_views(moment)))
        journal_.write_residuals(*change, backend.count(), first);
    if (!sharp_cameras_.empty() && moment.iteration % kSmoothingInterval == 0) backend.update_smoothing(sharp_cameras_);
    std::vector<StepRequest> requests;
    for (const StepView& view : views) requests.push_back(composer_.compose(view, moment));
    if (num_views > 1) StepComposer::combine(requests);
    cameras_.gather(requests, moment);
    backend.step_on(requests);
    last_moment_ = moment;
    journal_.write_change(densification_.after_step(backend, moment), last);
    schedule_.advance(backend.count(), num_views);
}

/// Returns the views of the next step: as many as the backend takes, but not beyond the next iteration at which an
/// output or a scan may be due.
std::vector<StepView> StepRunner::next_views(Backend& backend) {
    const std::int64_t first = schedule_.iteration(),
                       end = std::min({first + backend.views_per_step(), (first / kLogInterval + 1) * kLogInterval,
                                       next_output(output_, first), end_of_views()});
    std::vector<StepView> views;
    for (std::int64_t k = 0; first + k < end; ++k)
        views.push_back(views_.at(first + k, end_of_views(), schedule_.reduction(), backend.needs_pixels(int(k))));
    return views;
}

/// Returns the first iteration for which no image is decoded ahead.
std::int64_t StepRunner::end_of_views() const {
    return length_.ends_by_iterations() ? length_.iterations : std::numeric_limits<std::int64_t>::max();
}

/// Returns the source of requests for steps on single views at `moment`. Each request is valid until the next one is
/// made.
StepSource StepRunner::steps_on_views(const ScheduleMoment& moment) {
    return [this, moment](std::size_t view) {
        return composer_.compose(StepView{view, views_.image(view), views_.fixed_background()}, moment);
    };
}

void StepRunner::remove_surplus(Backend& backend) {
    backend.prune_invisible();
    limits_.prune(backend);
    if (const auto change = residuals_.at_end(backend, steps_on_views(schedule_.moment())))
        journal_.write_residuals(*change, backend.count(), schedule_.iteration());
}

double StepRunner::seconds_to_remove(Backend& backend) const {
    const double pruning = limits_.seconds_to_prune(backend);
    if (!chooses_residuals()) return pruning;
    return pruning + kWorthPerFrame * double(residuals_.views_at_end()) * limits_.view_seconds(backend);
}

StepRequest StepRunner::controller_step(std::int64_t k, const std::optional<std::int64_t>& steps) {
    const std::int64_t done = schedule_.iteration();
    return composer_.compose_distillation(views_.at(done + k, steps ? done + *steps : end_of_views()), done + k);
}

}  // namespace gs
