// SPDX-License-Identifier: Apache-2.0
// The stages of the search: a smaller scene, a training without view dependence, trials, the report.
#include "eval/auto/find_appearance.h"

#include "eval/auto/measure_appearances.h"

namespace gs {

AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene) {
    const AppearanceMeasurements measured = measure_appearances(options, scene);
    return describe_appearance(measured, decide_appearance(measured, options.auto_tolerance), options.auto_tolerance);
}

DirectionTest test_direction(const TrainOptions& options, const Scene& scene) {
    const AppearanceMeasurements measured = measure_appearances(options, scene, false);
    if (measured.obstacle) return {false, obstacle_text(measured)};
    return {!needs_trials(measured.parts, options.auto_tolerance), ""};
}

}  // namespace gs
