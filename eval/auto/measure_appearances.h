// SPDX-License-Identifier: Apache-2.0
// The measurements of `--appearance auto`: short trainings on part of the training views, compared on the rest.
#pragma once

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
/// Measures nothing where trials would have fewer than kFewestTrialIterations. The same options and seed give the same
/// measurements, but for times, unless time ran out. Without `with_trials` it ends before these. Throws what training
/// throws.
AppearanceMeasurements measure_appearances(const TrainOptions& options, const Scene& scene, bool with_trials = true);

}  // namespace gs
