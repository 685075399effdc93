// SPDX-License-Identifier: Apache-2.0
// Judges and replaces infinite parameters.
#include "lib/model/limit_values.h"

#include <algorithm>
#include <limits>

#include "kernels/base/portable.h"
#include "kernels/splat/raster_config.h"

namespace gs {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
/// The least log scale of files for viewers (docs/formats.md#scenengsplat), below any pixel in a frame of usual size.
constexpr float kLeastLogScale = -12;

}  // namespace

bool has_meaning(Group group, float raw) {
    if (gs_isfinite(raw)) return true;
    return (group == Group::kOpacity && raw == raw) || (group == Group::kScale && raw == -kInfinity);
}

std::int64_t make_trainable(Gaussians& g) {
    std::int64_t changed = 0;
    for (std::int64_t i = 0; i < g.count; ++i) {
        float& opacity = g[Group::kOpacity].param[std::size_t(i)];
        float* const scale = g[Group::kScale].param.data() + 3 * i;
        const bool flat = std::find(scale, scale + 3, -kInfinity) != scale + 3;
        if (gs_isfinite(opacity) && !flat) continue;
        ++changed;
        if (!gs_isfinite(opacity)) opacity = opacity > 0 ? float(kMaxRawOpacity) : -float(kMaxRawOpacity);
        std::replace(scale, scale + 3, -kInfinity, kLeastLogScale);
    }
    return changed;
}

}  // namespace gs
