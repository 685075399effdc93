// SPDX-License-Identifier: Apache-2.0
// Finds where cameras look.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "lib/scene/scene.h"

namespace gs {

/// Returns the point nearest to all optical axes in the least-squares sense, in the units of the cameras. A small pull
/// towards the cameras' mean decides where all look in one direction and the axes never meet.
Eigen::Vector3d common_target(const std::vector<View>& views);

/// Returns the mean of the cameras' unit axes. Its length is 1 where all look the same way, and 0 without a view.
Eigen::Vector3d mean_axis(const std::vector<View>& views);

}  // namespace gs
