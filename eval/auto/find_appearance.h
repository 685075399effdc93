// SPDX-License-Identifier: Apache-2.0
// `--appearance auto`: measures by short trainings on part of the training views, compared on the rest; decides;
// describes.
#pragma once

#include <string>

#include "eval/auto/appearance_choice.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Holds out every 8th training view, makes images at most 400 pixels wide and options.cap_max smaller in proportion,
/// and trains `none` for a fifteenth of options.iterations. Measures what its errors consist of (residual_parts). Where
/// needs_trials says so, goes on from there with each model of the registry that is no variant. Test views are not
/// looked at. Takes at most half as long as the run that would follow, as far as a trial's iterations tell: a trial
/// that would exceed this, or does, has no result and is unfinished. (What comes before the trials, and the first of
/// them, always ends.) With options.time_limit all of this has a tenth of it, and the first trial need not end.
/// Measures nothing if trials would have fewer than kFewestTrialIterations. The same options and seed give the same
/// measurements, but for times, unless time ran out. Without `with_trials` it ends before these. Throws what training
/// throws.
AppearanceMeasurements measure_appearances(const TrainOptions& options, const Scene& scene, bool with_trials = true);

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
