// SPDX-License-Identifier: Apache-2.0
// Counts non-finite values, and ends a training with too many of them.
#include "lib/train/step_monitor.h"

#include <fmt/format.h>

#include <string>

#include "kernels/base/error.h"
#include "lib/core/log.h"

namespace gs {

void StepMonitor::read(Backend& backend) {
    const StepStats stats = backend.take_stats();
    skipped_gradients_ += stats.num_nonfinite_gradients;
    if (stats.steps > 0) last_ = stats;
    if (stats.consecutive_skips < kStatsInterval) return;
    throw NumericError(fmt::format(
        "iteration {}: the loss of the last {} views was not finite (last view: {}). Lower the learning rates, or "
        "check the images",
        schedule_.iteration(), stats.consecutive_skips, views_.view_at(schedule_.iteration() - 1).name));
}

void StepMonitor::prune_nonfinite(Backend& backend) {
    const PruneStats pruned = backend.prune_nonfinite();
    if (pruned.removed == 0) return;
    std::string parameters;
    for (std::size_t g = 0; g < pruned.by_group.size(); ++g)
        if (pruned.by_group[g] > 0)
            parameters += fmt::format("{}{} {}", parameters.empty() ? "" : ", ", pruned.by_group[g], kGroupNames[g]);
    journal_.write_nonfinite(pruned.removed, parameters, schedule_.iteration());
    removed_gaussians_ += pruned.removed;
    if (backend.count() == 0)
        throw NumericError(fmt::format("iteration {}: no Gaussian with parameters finite and in range is left ({})",
                                       schedule_.iteration(), parameters));
}

void StepMonitor::report() const {
    if (skipped_gradients_)
        log_warning("{} non-finite Gaussian gradients were skipped during the run", skipped_gradients_);
    if (removed_gaussians_)
        log_warning("{} Gaussians were removed for parameters not finite or out of range during the run",
                    removed_gaussians_);
}

}  // namespace gs
