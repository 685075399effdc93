// SPDX-License-Identifier: Apache-2.0
// Computes the positions of a run's steps on the schedule.
#include "lib/train/timeline.h"

#include <algorithm>

namespace gs {

ScheduleMoment moment_at(const ScheduleOptions& options, std::int64_t iteration) {
    const double stride =
        options.schedule == ScheduleKind::kFixed ? 1 : kReferenceIterations / double(options.iterations);
    return {iteration, double(iteration) * stride, double(iteration - 1) * stride, stride};
}

ScheduleMoment next_moment(const ScheduleMoment& last, double progress) {
    // Progress may decrease although time passes, because a larger model takes longer to save.
    return {last.iteration + 1, std::max(last.position, kReferenceIterations * progress), last.position, last.pace};
}

}  // namespace gs
