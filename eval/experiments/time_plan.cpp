// SPDX-License-Identifier: Apache-2.0
// Expected times from measured ones.
#include "eval/experiments/time_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "lib/core/duration.h"
#include "lib/core/options.h"

namespace gs {

void TimePlan::add(const TrainOptions& options, double train_seconds, std::optional<double> wall_seconds) {
    ended_.push_back({options, train_seconds});
    if (wall_seconds) overhead_seconds_ = std::max(overhead_seconds_, *wall_seconds - train_seconds);
}

std::optional<double> TimePlan::seconds(const TrainOptions& options) const {
    if (!options.time_limit.empty()) return overhead_seconds_ + parse_duration(options.time_limit, "time-limit");
    std::optional<double> expected;
    double least = std::numeric_limits<double>::infinity();
    for (const Ended& run : ended_) {
        if (!ends_by_iterations(run.options)) continue;
        const double iterations = double(options.iterations) / double(run.options.iterations);
        const double gaussians = double(options.cap_max) / double(run.options.cap_max);
        // A step of 1 % in size weighs more than another appearance: these differ by less than a factor of two.
        const double distance = std::abs(std::log(iterations)) + std::abs(std::log(gaussians)) +
                                (run.options.appearance == options.appearance ? 0 : 0.01);
        if (distance >= least) continue;
        least = distance;
        expected = overhead_seconds_ + run.train_seconds * iterations * gaussians;
    }
    return expected;
}

}  // namespace gs
