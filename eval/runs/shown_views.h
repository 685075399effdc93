// SPDX-License-Identifier: Apache-2.0
// The views that a page offers to jump to, and what each Gaussian is worth to the pictures of such views.
#pragma once

#include <cstddef>
#include <vector>

#include "eval/runs/saved_run.h"
#include "lib/scene/scene.h"

namespace gs {

/// The number of views of a page whose photographs somebody may want to look through.
inline constexpr std::size_t kShownViews = 64;

/// Returns the test views, or the training views if there are none; `most` of them, evenly spread, if there are
/// more.
std::vector<View> shown_views(const Scene& scene, std::size_t most = kShownViews);

/// Returns all of `views`, or `most` of them, evenly spread, if there are more.
std::vector<View> spread_views(const std::vector<View>& views, std::size_t most);

/// Returns Backend::scores of `model` for at most 64 training views of the run, evenly spread, or for its test views
/// where it has no others; empty for a run without views. Uploads `model` to the run's backend.
std::vector<float> view_scores(SavedRun& run, const Gaussians& model);

}  // namespace gs
