// SPDX-License-Identifier: Apache-2.0
// Makes the first model of a new run, or continues from a checkpoint.
#include "lib/train/training_start.h"

#include <algorithm>
#include <utility>

#include "kernels/base/parallel.h"
#include "lib/core/log.h"
#include "lib/core/quantities.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/train/choose_backend.h"
#include "lib/train/group_backend.h"

namespace gs {
namespace {

/// The minimum number of points at the start of a training, however short its time limit is.
constexpr std::int64_t kLeastPoints = 1000;

InitOptions with_points(InitOptions init, std::int64_t most_points) {
    init.most_points = most_points;
    return init;
}

}  // namespace

std::unique_ptr<Backend> TrainingStart::make(RunStart& start) {
    set_num_threads(options_.threads);
    steps_.rates().log(options_);
    return start.checkpoint ? resume(*start.checkpoint) : begin(start);
}

/// Returns the backend of this run without a model, and sets the views of a step to its share.
std::unique_ptr<Backend> TrainingStart::empty_backend() {
    const AppearanceSpec appearance = appearance_spec(options_);
    const EngineOptions options = engine_options(options_);
    auto backend = hooks_.make_backend ? hooks_.make_backend(appearance, options)
                                       : make_backend(options_.device, appearance, options);
    log_device(options_.device, *backend);
    steps_.use(*backend);
    return backend;
}

std::unique_ptr<Backend> TrainingStart::begin(RunStart& start) {
    schedule_.charge(start.used_seconds);
    const AppearanceSpec appearance = appearance_spec(options_);
    const bool from_points = !start.initial;
    InitOptions init = with_points(init_options(options_), limits_.most_first_points());
    Gaussians first = from_points ? initialize_gaussians(scene_, appearance, init)
                                  : start_from(std::move(*start.initial), scene_, appearance, options_.seed);
    std::unique_ptr<Backend> backend = empty_backend();
    if (limits_.limits_frames())
        limits_.require_feasible(*backend, initialize_gaussians(scene_, appearance, with_points(init, 1)));
    if (schedule_.limits_time() && from_points && !options_.named.contains("init-points")) {
        init = with_points(init, affordable_points(*backend, first));
        if (init.most_points < first.count) first = initialize_gaussians(scene_, appearance, init);
    }
    first = steps_.begin(std::move(first), from_points);
    if (first.count > options_.cap_max)
        log_warning("{} initial Gaussians exceed --cap-max {}: they are kept, but none are added", first.count,
                    options_.cap_max);
    backend->upload(first);
    writer_.write_start(initial_points(scene_, init));
    return backend;
}

/// Returns the number of points that leaves time for enough steps under the time limit, at most the number of Gaussians
/// in `all`, the model made from all points.
std::int64_t TrainingStart::affordable_points(Backend& backend, const Gaussians& all) const {
    backend.upload(all);
    const std::int64_t affordable = schedule_.affordable_start(all.count, limits_.view_seconds(backend)),
                       points = std::min(all.count, std::max(kLeastPoints, affordable));
    if (points < all.count)
        log_debug("time limit {}: begins with {} of {} points, so that there is time for enough steps",
                  options_.time_limit->text(), points, all.count);
    return points;
}

std::unique_ptr<Backend> TrainingStart::resume(Checkpoint& checkpoint) {
    if (checkpoint.seed != options_.seed)
        log_warning("resuming with --seed {} a run that began with {}: it will differ from an uninterrupted one",
                    options_.seed, checkpoint.seed);
    if (!checkpoint.time)
        log_warning("the checkpoint does not say how long its {} iterations took: times count from here",
                    checkpoint.iteration);
    clock_.resume(checkpoint.time);
    schedule_.resume(checkpoint.iteration, checkpoint.time ? checkpoint.time->limited_seconds : 0);
    const Gaussians state = steps_.resume(std::move(checkpoint.state), checkpoint.cameras);
    std::unique_ptr<Backend> backend = empty_backend();
    backend->upload(state);
    writer_.write_config();
    log_info("resuming at iteration {} with {} Gaussians", checkpoint.iteration, backend->count());
    if (schedule_.finished() && options_.ends_by_iterations())
        log_warning("the checkpoint already has {} iterations, --iterations is {}: nothing is trained",
                    checkpoint.iteration, options_.iterations);
    return backend;
}

}  // namespace gs
