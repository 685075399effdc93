// SPDX-License-Identifier: Apache-2.0
// Schedules the changes of the set of Gaussians.
#include "lib/train/densification.h"

#include <algorithm>

#include "appearance/model_info.h"

namespace gs {
namespace {

/// The iterations between Morton sorts. Locality decays as rows are appended.
constexpr std::int64_t kMortonInterval = 5000;
/// ADC removes Gaussians larger than a tenth of the scene only after the first opacity reset has shown which are
/// needed.
constexpr std::int64_t kPruneLargeFrom = 3000;
/// ADC resets opacity once more, early, when a bright background could be taken for geometry.
constexpr std::int64_t kExtraReset = 500;

/// Speedy-Splat's pruning (docs/math/densification.md#schedule) starts after two opacity resets have shown which
/// Gaussians are needed, and repeats every 3000 iterations. These are iterations of the reference; they do not stretch
/// with the length of a run.
constexpr std::int64_t kScorePruneFrom = 6000, kScorePruneInterval = 3000;
/// Shares removed. While ADC still grows missing Gaussians, most can go; afterwards nothing comes back.
constexpr double kSoftRatio = 0.8, kHardRatio = 0.3;

}  // namespace

DensificationSchedule::DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance,
                                             double extent, bool black_background, std::vector<RenderRequest> views)
    : options_(options),
      initial_degree_(appearance_model(appearance.model).initial_degree),
      max_degree_(appearance.max_degree),
      degree_(std::min(initial_degree_, max_degree_)),
      extent_(extent),
      black_background_(black_background),
      views_(std::move(views)) {}

ScheduledChange DensificationSchedule::before_step(Backend& backend, std::int64_t iteration,
                                                   bool hold_view_dependence) {
    ScheduledChange change;
    if (iteration % kDegreeInterval == 0) {
        if (iteration > 0)
            degree_ = hold_view_dependence ? 0 : std::min(max_degree_, std::max(initial_degree_, degree_ + 1));
        backend.set_active_degree(degree_);
    }
    const bool adc = options_.strategy == Strategy::kAdc;
    const bool due = options_.strategy != Strategy::kNone && iteration >= options_.densify_from_iter &&
                     iteration <= options_.densify_until_iter &&
                     (iteration - options_.densify_from_iter) % options_.densification_interval == 0;
    if (due && adc) {
        AdcParams p;
        p.grad_threshold = float(options_.densify_grad_threshold);
        p.extent = float(extent_);
        p.prune_large = iteration > kPruneLargeFrom;
        p.cap = options_.cap_max;
        static_cast<DensifyStats&>(change) = backend.densify({p, iteration, options_.seed});
    } else if (due) {
        McmcParams p;
        p.cap = options_.cap_max;
        static_cast<DensifyStats&>(change) = backend.densify({p, iteration, options_.seed});
    }
    // Prune before the opacity reset, after which all Gaussians look alike.
    if (prunes_by_score(iteration) && iteration <= options_.densify_until_iter) prune(backend, kSoftRatio, change);
    if (iteration % kMortonInterval == 0 && iteration <= options_.densify_until_iter + kMortonInterval)
        backend.morton_sort();
    const bool reset =
        iteration > 0 && iteration < options_.densify_until_iter &&
        (iteration % options_.opacity_reset_interval == 0 || (iteration == kExtraReset && !black_background_));
    if (adc && reset) backend.reset_opacity();
    return change;
}

ScheduledChange DensificationSchedule::after_step(Backend& backend, std::int64_t iteration) {
    ScheduledChange change;
    if (prunes_by_score(iteration) && iteration > options_.densify_until_iter) prune(backend, kHardRatio, change);
    return change;
}

bool DensificationSchedule::prunes_by_score(std::int64_t iteration) const {
    return options_.speedy_splat && iteration >= kScorePruneFrom && iteration % kScorePruneInterval == 0;
}

void DensificationSchedule::prune(Backend& backend, double ratio, ScheduledChange& change) const {
    change.pruned_by_score = backend.prune(LowestScores{views_, ratio}).removed;
    change.count = backend.count();
}

}  // namespace gs
