// SPDX-License-Identifier: Apache-2.0
// `--appearance auto`: measures, decides, describes.
#pragma once

#include <string>

#include "eval/auto/appearance_report.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Measures models on the scene (measure_appearances), decides for one (decide_appearance, with options.auto_tolerance)
/// and says why (describe_appearance). Test views are not looked at. The same options and seed give the same choice
/// unless time ran out. Throws what training throws.
AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene);

/// Whether a model with residuals is of use to a scene.
struct DirectionTest {
    bool explains_nothing = false;  ///< less than options.auto_tolerance of what a model without residuals leaves
    std::string obstacle;           ///< why that could not be measured; empty if it was
};

/// Measures on held-out training views what direction explains. It takes the first part of find_appearance, before the
/// trials. Throws what training throws.
DirectionTest test_direction(const TrainOptions& options, const Scene& scene);

}  // namespace gs
