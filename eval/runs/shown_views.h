// SPDX-License-Identifier: Apache-2.0
// The views that a page offers to jump to.
#pragma once

#include <cstddef>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// The number of views of a page whose photographs somebody may want to look through.
inline constexpr std::size_t kShownViews = 64;

/// Returns the test views, or the training views where there are none; `most` of them, evenly spread, if there are
/// more.
std::vector<View> shown_views(const Scene& scene, std::size_t most = kShownViews);

/// Returns all of `views`, or `most` of them, evenly spread, if there are more.
std::vector<View> spread_views(const std::vector<View>& views, std::size_t most);

}  // namespace gs
