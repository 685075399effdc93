// SPDX-License-Identifier: Apache-2.0
#include "eval/auto/find_appearance.h"

#include "eval/auto/measure_appearances.h"

namespace gs {

AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene) {
    const AppearanceMeasurements measured = measure_appearances(options, scene);
    return describe_appearance(measured, decide_appearance(measured, options.auto_tolerance), options.auto_tolerance);
}

}  // namespace gs
