// SPDX-License-Identifier: Apache-2.0
// What each Gaussian of a finished run is worth to the pictures.
#pragma once

#include <vector>

#include "eval/runs/saved_run.h"

namespace gs {

/// Returns Backend::scores of `model` for at most 64 training views of the run, evenly spread, or for its test views
/// where it has no others; empty for a run without views. Uploads `model` to the run's backend.
std::vector<float> view_scores(SavedRun& run, const Gaussians& model);

}  // namespace gs
