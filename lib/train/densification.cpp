// SPDX-License-Identifier: Apache-2.0
#include "lib/train/densification.h"

#include <algorithm>

#include "appearance/model_info.h"

namespace gs {
namespace {

/// Iterations between degree steps, and between Morton sorts (locality decays as rows are appended).
constexpr std::int64_t kDegreeInterval = 1000, kMortonInterval = 5000;
/// ADC removes Gaussians larger than a tenth of the scene only after the first opacity reset has shown what is needed.
constexpr std::int64_t kPruneLargeFrom = 3000;
/// ADC resets once more, early, when a bright background could be taken for geometry.
constexpr std::int64_t kExtraReset = 500;

}  // namespace

DensificationSchedule::DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance, double extent, bool black_background)
    : options_(options),
      initial_degree_(appearance_model(appearance.model).initial_degree),
      max_degree_(appearance.max_degree),
      extent_(extent),
      black_background_(black_background) {}

int DensificationSchedule::active_degree(std::int64_t iteration) const {
    return int(std::min<std::int64_t>(max_degree_, initial_degree_ + iteration / kDegreeInterval));
}

bool DensificationSchedule::gathers(std::int64_t iteration) const {
    return options_.strategy == "adc" && iteration < options_.densify_until_iter;
}

DensifyStats DensificationSchedule::apply(Backend& backend, std::int64_t iteration) {
    DensifyStats stats;
    if (iteration % kDegreeInterval == 0) backend.set_active_degree(active_degree(iteration));
    const bool adc = options_.strategy == "adc";
    const bool due = options_.strategy != "none" && iteration >= options_.densify_from_iter && iteration <= options_.densify_until_iter &&
                     (iteration - options_.densify_from_iter) % options_.densification_interval == 0;
    if (due && adc) {
        AdcParams p;
        p.grad_threshold = float(options_.densify_grad_threshold);
        p.extent = float(extent_);
        p.prune_large = iteration > kPruneLargeFrom;
        p.cap = options_.cap_max;
        stats = backend.densify_adc(p, iteration, options_.seed);
    } else if (due) {
        McmcParams p;
        p.cap = options_.cap_max;
        stats = backend.densify_mcmc(p, iteration, options_.seed);
    }
    if (iteration % kMortonInterval == 0 && iteration <= options_.densify_until_iter + kMortonInterval) backend.morton_sort();
    const bool reset = iteration > 0 && iteration < options_.densify_until_iter &&
                       (iteration % options_.opacity_reset_interval == 0 || (iteration == kExtraReset && !black_background_));
    if (adc && reset) backend.reset_opacity();
    return stats;
}

}  // namespace gs
