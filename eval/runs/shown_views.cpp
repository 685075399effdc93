// SPDX-License-Identifier: Apache-2.0
// Picks views.
#include "eval/runs/shown_views.h"

#include <algorithm>

namespace gs {

std::vector<View> spread_views(const std::vector<View>& views, std::size_t most) {
    std::vector<View> out;
    const std::size_t count = std::min(most, views.size());
    for (std::size_t k = 0; k < count; ++k) out.push_back(views[k * views.size() / count]);
    return out;
}

std::vector<View> shown_views(const Scene& scene, std::size_t most) {
    return spread_views(scene.test.empty() ? scene.train : scene.test, most);
}

}  // namespace gs
