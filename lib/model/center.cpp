// SPDX-License-Identifier: Apache-2.0
// Finds the centre of a model.
#include "lib/model/center.h"

#include <utility>
#include <vector>

#include "lib/core/median.h"

namespace gs {

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

}  // namespace gs
