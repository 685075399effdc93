// SPDX-License-Identifier: Apache-2.0
// Puts together what is measured and on which backend.
#include "eval/bench/bench_cases.h"

#include <fmt/format.h>

#include "eval/bench/generated_set.h"
#include "lib/core/options.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"

namespace gs {

BenchOptions bench_options(Device device, int repeat, int frame_repeat) {
    const bool cuda = uses_cuda(device);
    return {.repeat = repeat > 0 ? repeat
                      : cuda     ? 100
                                 : 20,
            .frame_repeat = frame_repeat > 0 ? frame_repeat
                            : cuda           ? 100
                                             : 3};
}

BenchResult bench_model(Backend& backend, const TrainOptions& options, const Scene& scene, const Gaussians& model,
                        const BenchOptions& bench, bool compare_deterministic) {
    BenchResult result = run_bench(backend, options, scene, model, bench);
    if (!compare_deterministic) return result;
    BackendOptions other = backend_options(options);
    other.deterministic = !other.deterministic;
    const auto changed = make_backend(options.device, model.appearance, other);
    const double seconds = iteration_seconds(*changed, options, scene, model, bench);
    result.deterministic_seconds = options.deterministic ? result.iteration_seconds : seconds;
    result.default_seconds = options.deterministic ? seconds : result.iteration_seconds;
    return result;
}

BenchResult bench_generated(Backend& backend, const TrainOptions& options, std::int64_t count,
                            const BenchOptions& bench, bool compare_deterministic) {
    const Gaussians model = generated_gaussians(count, options.seed, appearance_spec(options));
    backend.upload(model);
    const Scene scene = generated_scene(backend, options.background.color);
    BenchResult result = bench_model(backend, options, scene, model, bench, compare_deterministic);
    result.subject = fmt::format("generated set of {:.3g} M Gaussians, seed {}", double(count) / 1e6, options.seed);
    return result;
}

}  // namespace gs
