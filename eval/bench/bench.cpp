// SPDX-License-Identifier: Apache-2.0
// Times steps and frames over decoded views.
#include "eval/bench/bench.h"

#include <algorithm>

#include "kernels/base/clock.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/model/initialize.h"
#include "lib/scene/camera_params.h"
#include "lib/scene/resized.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// The most views that are used: enough to average over, few enough that their images fit every memory.
constexpr std::size_t kMaxViews = 64;

/// Takes training steps over decoded views, one after another.
class Steps {
  public:
    Steps(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model, int repeat)
        : backend_(backend),
          composer_(options, model.appearance, scene, nullptr, kFrozenRates),
          background_(options.background.color) {
        const std::size_t all = scene.train.size(), used = std::min({all, kMaxViews, std::size_t(repeat)});
        for (std::size_t k = 0; k < used; ++k) {
            views_.push_back(k * all / used);  // spreads them over the scene
            images_.push_back(std::make_shared<const ViewImage>(scene.train[views_.back()].load()));
        }
        for (std::size_t k = 0; k < std::max<std::size_t>(2, used); ++k) step();
        backend_.synchronize();
    }

    void step() {
        const std::size_t k = next_++ % views_.size();
        backend_.step(composer_.compose({views_[k], images_[k], background_}, Moment{iteration_, double(iteration_)}));
        ++iteration_;
    }

    /// Returns the mean seconds of `count` steps from the first view on, of which only the last is waited for.
    double in_a_row(int count) {
        next_ = 0;
        const double start = seconds_now();
        for (int k = 0; k < count; ++k) step();
        backend_.synchronize();
        return (seconds_now() - start) / count;
    }

    /// Returns the median seconds of `count` steps that are each waited for.
    double median_alone(int count) {
        std::vector<double> times;
        for (int k = 0; k < count; ++k) {
            const double start = seconds_now();
            step();
            backend_.synchronize();
            times.push_back(seconds_now() - start);
        }
        std::nth_element(times.begin(), times.begin() + std::ptrdiff_t(times.size() / 2), times.end());
        return times[times.size() / 2];
    }

  private:
    Backend& backend_;
    const StepComposer composer_;
    const Vec3<float> background_;
    std::vector<std::size_t> views_;
    std::vector<std::shared_ptr<const ViewImage>> images_;
    std::int64_t iteration_ = 0;
    std::size_t next_ = 0;
};

/// Returns the costs of the stages per iteration.
std::vector<StageCost> measure_stages(Backend& backend, Steps& steps, int repeat) {
    for (int pass = 0; pass < backend.stage_passes(); ++pass) {
        backend.measure_stages(pass);
        if (pass == 0) {  // a device may have to prepare for the marks
            steps.step();
            backend.synchronize();
            backend.measure_stages(pass);
        }
        steps.in_a_row(repeat);
    }
    std::vector<StageCost> stages = backend.measure_stages({});
    for (StageCost& s : stages)
        for (double* sum : {&s.seconds, &s.items, &s.bytes, &s.operations}) *sum /= repeat;
    return stages;
}

FrameTime time_frames(Backend& backend, const std::vector<Camera>& cameras, const Vec3<float>& background,
                      int repeats) {
    std::vector<RenderRequest> requests(cameras.size());
    for (std::size_t k = 0; k < cameras.size(); ++k)
        requests[k].camera = camera_params(cameras[k]), requests[k].background = background,
        requests[k].isp.mode = IspMode::kController;
    return {cameras[0].width, cameras[0].height, int(cameras.size()), backend.time_frames(requests, repeats)};
}

std::vector<FrameTime> time_all_frames(Backend& backend, const Scene& scene, const Vec3<float>& background,
                                       int repeats) {
    std::vector<Camera> own, resized;
    for (const View& view : scene.test.empty() ? scene.train : scene.test) {
        own.push_back(view.camera);
        resized.push_back(with_size(view.camera, kFrameWidth, kFrameHeight));
    }
    std::vector<FrameTime> frames = {time_frames(backend, own, background, repeats)};
    const auto same = [](const Camera& c) { return c.width == kFrameWidth && c.height == kFrameHeight; };
    if (!std::all_of(own.begin(), own.end(), same))
        frames.push_back(time_frames(backend, resized, background, repeats));
    return frames;
}

}  // namespace

Gaussians initial_model(const TrainOptions& options, const Scene& scene) {
    const AppearanceSpec appearance = appearance_spec(options);
    Gaussians model = initialize_gaussians(scene, appearance, init_options(options));
    model.active_degree = appearance.max_degree;
    return model;
}

BenchResult run_bench(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                      const BenchOptions& bench) {
    BenchResult result;
    result.device = backend.describe();
    result.ceilings = backend.measure_ceilings();
    result.num_gaussians = model.count;
    result.width = scene.train.at(0).camera.width, result.height = scene.train[0].camera.height;
    result.repeat = bench.repeat;
    backend.upload(model);
    result.frames = time_all_frames(backend, scene, options.background.color, bench.frame_repeat);

    Steps steps(backend, options, scene, model, bench.repeat);
    result.iteration_seconds = steps.in_a_row(bench.repeat);
    result.iteration_seconds_median = steps.median_alone(bench.repeat);
    result.stages = measure_stages(backend, steps, bench.repeat);
    if (model.active_degree > 0 && model[Group::kResidual].width > 0) {
        backend.set_active_degree(0);
        result.without_residual = measure_stages(backend, steps, bench.repeat);
        backend.set_active_degree(model.active_degree);
    }
    result.memory = backend.memory();
    return result;
}

double frame_seconds(Backend& backend, const std::vector<View>& views, const Vec3<float>& background, int repeats) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return time_frames(backend, cameras, background, repeats).seconds;
}

double iteration_seconds(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                         const BenchOptions& bench) {
    backend.upload(model);
    return Steps(backend, options, scene, model, bench.repeat).in_a_row(bench.repeat);
}

StageCost appearance_share(const BenchResult& result, std::size_t k) {
    StageCost share = result.stages[k];
    const StageCost& without = result.without_residual[k];
    share.seconds -= without.seconds, share.bytes -= without.bytes, share.operations -= without.operations;
    return share;
}

}  // namespace gs
