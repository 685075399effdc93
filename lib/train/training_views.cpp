// SPDX-License-Identifier: Apache-2.0
// Delivers the training views in the order of a run and decodes them ahead of their use.
#include "lib/train/training_views.h"

#include <algorithm>
#include <string>
#include <thread>

#include "kernels/core/rng.h"
#include "lib/core/bytes.h"
#include "lib/train/choose_backend.h"

namespace gs {
namespace {

/// Views decoded ahead of the one in use, and threads that decode them. A GPU needs only a fraction of a view's
/// decoding time and leaves the processor free; the CPU backend needs all of the processor.
int views_ahead(Device device) { return uses_cuda(device) ? 24 : 3; }
int decode_threads(Device device) {
    return uses_cuda(device) ? std::clamp(int(std::thread::hardware_concurrency()) / 2, 1, views_ahead(device)) : 1;
}

}  // namespace

TrainingViews::TrainingViews(const TrainOptions& options, const Scene& scene)
    : options_(options),
      scene_(scene),
      background_(options.background),
      order_(scene.train.size(), options.seed),
      prefetch_(std::min<std::int64_t>(views_ahead(options.device), std::int64_t(scene.train.size()) / 2 + 1)),
      images_(scene.train, parse_bytes(options.image_cache), decode_threads(options.device)) {}

void TrainingViews::prefetch(std::int64_t first, std::int64_t end) {
    for (std::int64_t k = first; k < std::min(end, first + prefetch_); ++k) images_.prefetch(order_.at(k));
}

TrainingViews::Step TrainingViews::at(std::int64_t iteration, std::int64_t end) {
    Step step;
    step.index = order_.at(iteration);
    step.image = images_.get(step.index);
    if (iteration + prefetch_ < end) images_.prefetch(ahead_.at(iteration + prefetch_));
    step.background = background_at(iteration);
    return step;
}

Vec3<float> TrainingViews::background_at(std::int64_t iteration) const {
    if (!background_.random()) return fixed_background();
    const Philox4 r = philox(options_.seed, RngStream::kBackground, std::uint64_t(iteration), 0);
    return {uniform_from_bits(r.v[0]), uniform_from_bits(r.v[1]), uniform_from_bits(r.v[2])};
}

}  // namespace gs
