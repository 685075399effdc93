// SPDX-License-Identifier: Apache-2.0
// Schedules the changes of the set of Gaussians.
#include "lib/train/densification.h"

#include <algorithm>
#include <cmath>

#include "appearance/model_info.h"

namespace gs {
namespace {

/// The constants are positions (timeline.h), equal to iterations of the reference trainer.

/// The interval of Morton sorts while rows are appended and while they are only relocated, and its minimum number of
/// steps. After a sort the Gaussians of a view lie in few warps, which saves more time than the sort takes.
constexpr double kMortonWhileGrowing = 100, kMortonInterval = 500, kLeastMortonSteps = 100;
/// ADC removes Gaussians larger than a tenth of the scene only after the first opacity reset has revealed the needed
/// Gaussians.
constexpr double kPruneLargeFrom = 3000;
/// The position of ADC's extra early opacity reset, for backgrounds that could be mistaken for geometry.
constexpr double kExtraReset = 500;

/// Speedy-Splat's pruning (docs/math/densification.md#schedule) starts after two opacity resets have revealed the
/// needed Gaussians.
constexpr double kScorePruneFrom = 6000, kScorePruneInterval = 3000;
/// The removed shares. While ADC still regrows missing Gaussians, most can be removed; afterwards none are regrown.
constexpr double kSoftRatio = 0.8, kHardRatio = 0.3;

/// The interval of densifications, and its minimum number of steps, in which a Gaussian can prove useful.
constexpr double kInterval = 100, kLeastSteps = 10;

/// Returns the smallest multiple of `interval` that lasts at least `least_steps` steps.
double stretched(double interval, double least_steps, const ScheduleMoment& moment) {
    return interval * std::max(1.0, std::ceil(least_steps * moment.stride() / interval));
}

}  // namespace

DensificationWindow::DensificationWindow(const DensificationOptions& options)
    : from(options.densify_from_iter, 600),
      until(options.densify_until_iter, options.strategy == Strategy::kMcmc ? 24900 : 14900),
      interval(options.densification_interval, kInterval) {}

bool DensificationWindow::due(const ScheduleMoment& moment) const {
    if (!from.reached(moment) || until.exceeded(moment)) return false;
    // Intervals count from the first densification if both are on the same scale.
    const bool one_scale = interval.named() == from.named() || moment.position == double(moment.iteration);
    const double first = one_scale ? from.value() : 0;
    const double length = interval.named() ? interval.value() : stretched(kInterval, kLeastSteps, moment);
    return multiples_passed(interval.before(moment), interval.now(moment), length, first) > 0;
}

DensificationSchedule::DensificationSchedule(const TrainOptions& options, const AppearanceSpec& appearance,
                                             double extent, bool black_background, std::vector<RenderRequest> views)
    : options_(options),
      cap_(options.cap_max),
      seed_(options.seed),
      initial_degree_(appearance_model(appearance.model).initial_degree),
      max_degree_(appearance.max_degree),
      degree_(std::min(initial_degree_, max_degree_)),
      extent_(extent),
      black_background_(black_background),
      window_(options),
      reset_(options.opacity_reset_interval, 3000),
      views_(std::move(views)) {}

ScheduledChange DensificationSchedule::before_step(Backend& backend, const ScheduleMoment& moment,
                                                   bool hold_view_dependence,
                                                   const std::function<std::int64_t()>& most) {
    ScheduledChange change;
    if (const auto degrees = multiples_passed(moment.before, moment.position, kDegreeInterval)) {
        if (moment.iteration > 0)
            degree_ = hold_view_dependence
                          ? 0
                          : int(std::min<std::int64_t>(max_degree_,
                                                       std::max<std::int64_t>(initial_degree_, degree_ + degrees)));
        backend.set_active_degree(degree_);
    }
    const bool adc = options_.strategy == Strategy::kAdc;
    const bool due = options_.strategy != Strategy::kNone && window_.due(moment);
    if (due && adc) {
        AdcParams p;
        p.grad_threshold = float(options_.densify_grad_threshold);
        p.dense_fraction = float(options_.percent_dense);
        p.extent = float(extent_);
        p.prune_large = moment.position > kPruneLargeFrom;
        p.cap = most ? most() : cap_;
        static_cast<DensifyStats&>(change) = backend.densify({p, moment.iteration, seed_});
    } else if (due) {
        McmcParams p;
        p.by_gradient = options_.growth_by == GrowthBy::kGradient;
        p.cap = most ? most() : cap_;
        static_cast<DensifyStats&>(change) = backend.densify({p, moment.iteration, seed_});
    }
    // Prune before the opacity reset, which makes all Gaussians look alike.
    if (prunes_by_score(moment) && !window_.until.exceeded(moment)) prune(backend, kSoftRatio, change);
    const bool grew = change.added + change.cloned + change.split > 0;
    const double sorted_every = stretched(grew ? kMortonWhileGrowing : kMortonInterval, kLeastMortonSteps, moment);
    if (multiples_passed(moment.before, moment.position, sorted_every) > 0 &&
        window_.until.now(moment) <= window_.until.value() + kMortonInterval)
        backend.morton_sort();
    const bool reset = moment.iteration > 0 && !window_.until.reached(moment) &&
                       (multiples_passed(reset_.before(moment), reset_.now(moment), reset_.value()) > 0 ||
                        (moment.before < kExtraReset && moment.position >= kExtraReset && !black_background_));
    if (adc && reset) backend.densify({OpacityReset{}, 0, 0});
    return change;
}

ScheduledChange DensificationSchedule::after_step(Backend& backend, const ScheduleMoment& moment) {
    ScheduledChange change;
    if (prunes_by_score(moment) && window_.until.exceeded(moment)) prune(backend, kHardRatio, change);
    return change;
}

bool DensificationSchedule::prunes_by_score(const ScheduleMoment& moment) const {
    return options_.speedy_splat && moment.position >= kScorePruneFrom &&
           multiples_passed(moment.before, moment.position, kScorePruneInterval) > 0;
}

void DensificationSchedule::prune(Backend& backend, double ratio, ScheduledChange& change) const {
    change.pruned_by_score = backend.prune_lowest_scores(views_, ratio);
    change.count = backend.count();
}

}  // namespace gs
