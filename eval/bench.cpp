// SPDX-License-Identifier: Apache-2.0
#include "eval/bench.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "kernels/core/parallel.h"
#include "lib/model/initialize.h"
#include "lib/scene/camera_params.h"
#include "lib/train/choose_backend.h"
#include "lib/train/learning_rates.h"
#include "lib/train/target_image.h"
#include "lib/train/trainer.h"

namespace gs {
namespace {

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

}  // namespace

BenchResult run_bench(const TrainOptions& options, const Scene& scene, const BenchOptions& bench) {
    set_num_threads(options.threads);
    const AppearanceSpec appearance = appearance_spec(options);
    InitOptions init;
    init.mcmc = bench.mcmc_init;
    init.random_points = options.init_points;
    init.seed = options.seed;
    Gaussians state = initialize_gaussians(scene, appearance, init);
    state.active_degree = appearance.max_degree;
    const auto backend = choose_backend(options.device, appearance, backend_options(options));
    backend->upload(state);
    const LearningRates rates(options, appearance, scene);

    BenchResult result;
    result.ceilings = backend->measure_ceilings();
    result.device = backend->describe();
    result.num_gaussians = state.count;
    std::vector<double> times;
    RenderedImage rendered;
    const auto over_views = [&](auto&& work) {
        constexpr int kWarmUp = 2;
        double seconds = 0;
        for (int k = 0; k < bench.iterations + kWarmUp; ++k) {
            const View& view = scene.train[(std::size_t(k) * 37) % scene.train.size()]; // spread over the scene
            const ViewImage image = view.load();
            StepRequest request;
            request.camera = camera_params(view.camera);
            request.target = target_image(image);
            request.iteration = k;
            rates.apply(k, request);
            if (!bench.mcmc_init) request.opacity_reg = request.scale_reg = request.noise = 0;
            if (k == kWarmUp) backend->take_stage_costs();
            const double start = now();
            work(request);
            if (k >= kWarmUp) times.push_back(now() - start), seconds += times.back();
        }
        return seconds / bench.iterations;
    };
    result.frame_seconds = over_views([&](const StepRequest& r) {
        RenderRequest frame;
        frame.camera = r.camera;
        backend->render(frame, rendered);
    });
    times.clear();
    result.iteration_seconds = over_views([&](const StepRequest& r) { backend->step(r); });
    result.stages = backend->take_stage_costs();
    for (StageCost& s : result.stages) s.seconds /= bench.iterations, s.items /= bench.iterations, s.bytes /= bench.iterations, s.operations /= bench.iterations;
    result.width = scene.train[0].camera.width, result.height = scene.train[0].camera.height;
    std::nth_element(times.begin(), times.begin() + std::ptrdiff_t(times.size() / 2), times.end());
    result.iteration_seconds_median = times[times.size() / 2];
    return result;
}

std::string format_bench(const BenchResult& r) {
    std::string out = fmt::format("{}; {} Gaussians, {}x{}\ncopy {:.1f} GB/s, {:.0f} G single-precision FMA/s\n"
                                  "iteration {:.2f} ms (median {:.2f}), frame {:.2f} ms\n\n",
                                  r.device, r.num_gaussians, r.width, r.height, r.ceilings.copy_bytes_per_second / 1e9, r.ceilings.operations_per_second / 1e9,
                                  1e3 * r.iteration_seconds, 1e3 * r.iteration_seconds_median, 1e3 * r.frame_seconds);
    out += "| stage | ms | items | ns per item | floor ms | measured/floor |\n|---|---:|---:|---:|---:|---:|\n";
    for (const StageCost& s : r.stages) {
        const double floor = std::max(s.bytes / r.ceilings.copy_bytes_per_second, s.operations / r.ceilings.operations_per_second);
        out += fmt::format("| {} | {:.3f} | {:.3g} M {} | {:.3f} | {:.3f} | {:.1f} |\n", s.stage, 1e3 * s.seconds, s.items / 1e6, s.item,
                           s.items > 0 ? 1e9 * s.seconds / s.items : 0, 1e3 * floor, floor > 0 ? s.seconds / floor : 0);
    }
    return out;
}

}  // namespace gs
