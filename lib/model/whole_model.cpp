// SPDX-License-Identifier: Apache-2.0
// Computes the centre, transforms means and scales into a frame, and checks and replaces infinite parameters.
#include "lib/model/whole_model.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "kernels/base/portable.h"
#include "kernels/splat/raster_config.h"
#include "lib/core/median.h"
#include "lib/scene/frame.h"

namespace gs {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
/// The smallest log scale in files for viewers (docs/formats.md#scenengsplat), smaller than any pixel in a frame of
/// usual size.
constexpr float kLeastLogScale = -12;

}  // namespace

Eigen::Vector3d median_center(const Gaussians& gaussians) {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    const std::vector<float>& means = gaussians[Group::kMean].param;
    for (int axis = 0; axis < 3 && gaussians.count > 0; ++axis) {
        std::vector<double> values;
        for (std::int64_t i = 0; i < gaussians.count; ++i) values.push_back(means[std::size_t(3 * i + axis)]);
        center[axis] = median(std::move(values));
    }
    return center;
}

void bring_into_frame(Gaussians& gaussians, const Frame& frame) {
    if (frame.is_identity()) return;
    const FileCoordinates scene{frame};
    std::vector<float>& means = gaussians[Group::kMean].param;
    for (std::size_t i = 0; i < means.size(); ++i) means[i] = float(scene.from_file(means[i], int(i % 3)));
    for (float& scale : gaussians[Group::kScale].param) scale = float(scene.size_from_file(scale));
}

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
