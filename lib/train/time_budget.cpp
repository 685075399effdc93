// SPDX-License-Identifier: Apache-2.0
// Divides the time of a run.
#include "lib/train/time_budget.h"

#include <algorithm>

namespace gs {
namespace {

/// The least steps that tell how long one takes.
constexpr std::int64_t kLeastSteps = 5;

}  // namespace

void TimeBudget::start(const TimeCosts& costs, std::int64_t iteration) {
    costs_ = costs;
    start_ = clock_();
    marked_seconds_ = elapsed(), marked_iteration_ = iteration;
}

double TimeBudget::for_steps(std::int64_t count) const {
    return limit_ - kept_back_ - costs_.at_end - kSavingOverhead - costs_.saving_per_gaussian * double(count);
}

double TimeBudget::progress(std::int64_t count) const {
    const double all = for_steps(count);
    return all > 0 ? std::clamp(elapsed() / all, 0.0, 1.0) : 1;
}

std::int64_t TimeBudget::affordable(std::int64_t count, std::int64_t iteration, bool coarse) {
    const std::int64_t steps = iteration - marked_iteration_;
    if (steps < kLeastSteps) return count;
    const double now = elapsed(), step = (now - marked_seconds_) / double(steps) * (coarse ? costs_.coarse_ratio : 1),
                 left = for_steps(count) - now, wanted = wanted_steps_ * (1 - progress(count));
    marked_seconds_ = now, marked_iteration_ = iteration;
    if (wanted < 1) return count;
    return std::int64_t(std::clamp(double(count) * left / (step * wanted), 1.0, 1e12));
}

}  // namespace gs
