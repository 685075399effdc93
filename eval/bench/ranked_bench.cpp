// SPDX-License-Identifier: Apache-2.0
// Takes steps on several views of a generated set, between two reports of all ranks.
#include "eval/bench/ranked_bench.h"

#include <fmt/format.h>

#include <algorithm>

#include "eval/bench/generated_set.h"
#include "kernels/base/clock.h"
#include "lib/model/appearance_spec.h"
#include "lib/train/choose_backend.h"
#include "lib/train/sharded_backend.h"
#include "lib/train/step_composer.h"

namespace gs {
namespace {

/// Steps before the clock starts, in which memory is taken and connections find their speed.
constexpr int kFirstSteps = 3;

}  // namespace

RankedBenchResult bench_ranks(RankTeam* team, const TrainOptions& options, std::int64_t count,
                              const BenchOptions& bench) {
    const AppearanceSpec appearance = appearance_spec(options);
    RankedBenchResult result;
    result.subject = fmt::format("generated set of {:.3g} M Gaussians, seed {}", double(count) / 1e6, options.seed);
    result.num_gaussians = count;
    result.steps = bench.repeat;
    result.views_per_step = views_of_step(options.batch, team);
    Gaussians model = generated_gaussians(count, options.seed, appearance);
    Scene scene;
    {
        const auto renders = make_sharded_backend(team, options.device, appearance, backend_options(options));
        renders->upload(model);
        scene = generated_scene(*renders, options.background.color);
    }
    result.width = scene.train[0].camera.width, result.height = scene.train[0].camera.height;
    std::vector<std::shared_ptr<const ViewImage>> images;
    std::vector<Image> photographs;
    for (const View& view : scene.train) {
        images.push_back(std::make_shared<const ViewImage>(view.load()));
        photographs.push_back(images.back()->color);
    }
    MessageWriter targets;
    put_targets(targets, photographs);
    const auto backend = make_sharded_backend(team, options.device, appearance, backend_options(options),
                                              result.views_per_step, targets);
    result.device = backend->describe();
    backend->upload(model);
    model = {};  // so that rank 0 holds what it holds in a training
    const StepComposer composer(options, appearance, scene, nullptr, kFrozenRates);
    std::int64_t iteration = 0;
    const auto step = [&] {
        std::vector<StepRequest> views;
        for (int k = 0; k < result.views_per_step; ++k, ++iteration) {
            const std::size_t view = std::size_t(iteration) % images.size();
            views.push_back(
                composer.compose({view, backend->needs_pixels(k) ? images[view] : nullptr, options.background.color},
                                 Moment{iteration, double(iteration)}));
        }
        StepComposer::combine(views);
        backend->step_on(views);
    };
    for (int k = 0; k < kFirstSteps; ++k) step();
    backend->take_reports();
    const double start = seconds_now();
    for (int k = 0; k < result.steps; ++k) step();
    backend->synchronize();
    result.seconds = seconds_now() - start;
    result.ranks = backend->take_reports();
    result.link = backend->measure_connection();
    if (const DeviceLink* link = team ? team->communicator().link() : nullptr) result.link_name = link->name();
    return result;
}

double exchange_floor(const RankedBenchResult& result) {
    if (result.ranks.size() < 2) return 0;
    double most = 0;
    for (const RankReport& rank : result.ranks)
        most = std::max({most, rank.costs.traffic.sent, rank.costs.traffic.received});
    const Traffic& traffic = result.ranks[0].costs.traffic;
    const double of_devices = double(traffic.device_exchanges), of_hosts = double(traffic.exchanges) - of_devices;
    return (most / result.link.bytes_per_second + of_hosts * result.link.latency_seconds +
            of_devices * result.link.device_latency_seconds) /
           result.steps;
}

}  // namespace gs
