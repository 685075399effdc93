// SPDX-License-Identifier: Apache-2.0
// Chooses the views that a page links to, and scores the contribution of each Gaussian to the images of such views.
#pragma once

#include <cstddef>
#include <vector>

#include "eval/runs/saved_run.h"
#include "lib/scene/scene.h"

namespace gs {

/// Number of views on a page with photographs to look through.
inline constexpr std::size_t kShownViews = 64;

/// Returns the test views, or the training views if there are none; if there are more than `most`, `most` of them,
/// evenly spaced.
std::vector<View> shown_views(const Scene& scene, std::size_t most = kShownViews);

/// Returns all of `views`, or `most` of them, evenly spaced, if there are more.
std::vector<View> spread_views(const std::vector<View>& views, std::size_t most);

/// Returns Backend::scores of `model` for at most 64 training views of the run, evenly spaced, or for its test views if
/// it has no training views; empty for a run without views. Uploads `model` to the run's backend.
std::vector<float> view_scores(SavedRun& run, const Gaussians& model);

}  // namespace gs
