// SPDX-License-Identifier: Apache-2.0
// Trains the segments, and transfers a model to another appearance.
#include "lib/train/trial_training.h"

#include <algorithm>

#include "appearance/model_info.h"
#include "kernels/base/clock.h"
#include "kernels/base/error.h"
#include "lib/core/interrupt.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/densification.h"
#include "lib/train/group_backend.h"
#include "lib/train/photometric.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// The range of positions whose learning rates continue_with() compresses: from the position at which all models learn
/// at full rate (spherical Voronoi waits until 1000, the network until 3000) to the end.
constexpr double kFirstRate = 3000, kLastRate = 30000;
/// The number of iterations between two checks of the backend, as in a run.
constexpr std::int64_t kCheckInterval = 100;

void check(Backend& backend, const std::string& model) {
    if (interrupted()) throw Interrupted("interrupted in short trainings for a choice; nothing was trained");
    backend.prune_nonfinite();
    if (backend.count() == 0 || backend.take_stats().consecutive_skips >= kCheckInterval / 2)
        throw NumericError("appearance " + model +
                           ": the parameters or the loss of a short training do not stay finite");
}

/// Returns the Gaussians of `state` with another appearance model and the same colours: the residual is 0, and all
/// degrees are active. The result has no moments. `state` must have a model without a residual.
Gaussians with_appearance(const Gaussians& state, const AppearanceSpec& appearance, const Scene& scene,
                          std::uint64_t seed) {
    const ModelInfo& model = appearance_model(appearance.model);
    Gaussians out;
    out.count = state.count, out.appearance = appearance, out.active_degree = appearance.max_degree,
    out.antialiased = state.antialiased, out.ppisp = state.ppisp;
    for (int g = 0; g < kNumGroups; ++g)
        out.groups[g].width = state.groups[g].width, out.groups[g].param = state.groups[g].param;
    GroupArrays<float>& residual = out[Group::kResidual];
    residual.width = group_width(Group::kResidual, appearance);
    residual.param.assign(std::size_t(out.count) * residual.width, 0.0f);
    initialize_residuals(scene, out);
    if (model.clear_residual)
        for (std::int64_t i = 0; i < out.count; ++i)
            model.clear_residual(appearance.max_degree, residual.param.data() + i * residual.width);
    out.shared.width = model.num_shared;
    out.shared.param.assign(std::size_t(model.num_shared), 0.0f);
    if (model.num_shared > 0) model.init_shared(seed, out.shared.param.data());
    return out;
}

}  // namespace

TrialTraining::TrialTraining(const TrainOptions& options, const Scene& scene) : scene_(scene), views_(options, scene) {}

TrialResult TrialTraining::begin(const TrainOptions& options, std::int64_t iterations, CameraRefinement* cameras) {
    const Photometric photometric(options, scene_);
    const AppearanceSpec appearance = appearance_spec(options);
    const StepComposer composer(options, appearance, scene_, &photometric);
    std::vector<RenderRequest> training_views;
    for (const View& view : scene_.train)
        training_views.push_back({.camera = camera_params(view.camera), .background = background()});
    DensificationSchedule schedule(options, appearance, scene_.extent, options.background.always(0, 0, 0),
                                   training_views);
    Gaussians state = initialize_gaussians(scene_, appearance, init_options(options));
    state.antialiased = options.antialiasing == Antialiasing::kOn, state.ppisp = photometric.initial_state();
    TrialResult result{make_backend(options.device, appearance, engine_options(options))};
    result.backend->upload(state);
    run(result, appearance.model, iterations, 0, std::numeric_limits<double>::infinity(),
        [&](std::int64_t k, const StepView& view) {
            const ScheduleMoment moment = moment_at(options, k);
            if (cameras) cameras->before_step(*result.backend, moment);
            schedule.before_step(*result.backend, moment);
            StepRequest request = composer.compose(view, moment);
            if (cameras) cameras->gather({&request, 1}, moment);
            return request;
        });
    begun_ = iterations;
    return result;
}

std::optional<TrialResult> TrialTraining::continue_with(const Gaussians& state, const TrainOptions& options,
                                                        std::int64_t iterations, double most_seconds) {
    const AppearanceSpec appearance = appearance_spec(options);
    Photometric photometric(options, scene_);
    TrainOptions resting = options;
    resting.strategy = Strategy::kNone;  // no noise on the means
    const StepComposer composer(resting, appearance, scene_, &photometric);
    Gaussians start = with_appearance(state, appearance, scene_, options.seed);
    TrialResult result{make_backend(options.device, appearance, engine_options(options))};
    photometric.resume(start, moment_at(options, begun_));
    result.backend->upload(start);
    const bool finished =
        run(result, appearance.model, iterations, begun_, most_seconds, [&](std::int64_t k, const StepView& view) {
            const auto rates = std::int64_t(kFirstRate + (kLastRate - kFirstRate) * double(k) / double(iterations));
            return composer.compose(view, moment_at(options, begun_ + k), {rates, double(rates), double(rates - 1)});
        });
    return finished ? std::optional(std::move(result)) : std::nullopt;
}

bool TrialTraining::run(TrialResult& result, const std::string& model, std::int64_t iterations, std::int64_t first,
                        double most_seconds, const std::function<StepRequest(std::int64_t, const StepView&)>& compose) {
    const double start = seconds_now();
    Backend& backend = *result.backend;
    views_.prefetch(first, first + iterations);
    for (std::int64_t k = 0; k < iterations; ++k) {
        if (seconds_now() - start > most_seconds) return false;
        const StepView step = views_.at(first + k, first + iterations);
        backend.step(compose(k, step));
        if ((k + 1) % kCheckInterval == 0 || k + 1 == iterations) check(backend, model);
    }
    backend.synchronize();
    result.seconds = seconds_now() - start;
    return true;
}

}  // namespace gs
