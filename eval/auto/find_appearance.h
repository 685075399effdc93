// SPDX-License-Identifier: Apache-2.0
// `--appearance auto`: measures models by short trainings on part of the training views, compares them on the rest,
// chooses one and describes the choice.
#pragma once

#include <string>

#include "eval/auto/appearance_choice.h"
#include "lib/core/train_options.h"
#include "lib/scene/scene.h"

namespace gs {

/// Holds out every 8th training view, makes images at most 400 pixels wide and options.cap_max smaller in proportion,
/// and trains `none` for a fifteenth of options.iterations. Measures the composition of its errors (residual_parts). If
/// needs_trials holds, continues from there with each model of the registry that is not a variant. Test views are not
/// used. Takes at most half as long as the run that would follow, as estimated from a trial's iterations: a trial that
/// would exceed this limit, or does, has no result and is listed as unfinished. (The steps before the trials, and the
/// first trial, always complete.) With options.time_limit all measurements have a tenth of it, and the first trial need
/// not complete. Measures nothing if trials would have fewer than kFewestTrialIterations. The same options and seed
/// give the same measurements, except for times, unless time ran out. Without `with_trials` it ends before the trials.
/// Throws the errors of the training.
AppearanceMeasurements measure_appearances(const TrainOptions& options, const Scene& scene, bool with_trials = true);

/// Measures models on the scene (measure_appearances), chooses one (decide_appearance, with options.auto_tolerance) and
/// explains the choice (describe_appearance). Test views are not used. The same options and seed give the same choice
/// unless time ran out. Throws the errors of the training.
AppearanceReport find_appearance(const TrainOptions& options, const Scene& scene);

/// Whether a scene benefits from a model with residuals.
struct DirectionTest {
    /// Whether direction explains less than options.auto_tolerance, dB, of the error of a model without residuals.
    bool explains_nothing = false;
    std::string obstacle;  ///< reason for a missing measurement; empty if measured
};

/// Measures on held-out training views how much of the error direction explains. Runs the first part of
/// find_appearance, before the trials. Throws the errors of the training.
DirectionTest test_direction(const TrainOptions& options, const Scene& scene);

}  // namespace gs
