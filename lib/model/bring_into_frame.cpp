// SPDX-License-Identifier: Apache-2.0
// Moves means and scales into a frame.
#include "lib/model/bring_into_frame.h"

#include <cmath>

namespace gs {

void bring_into_frame(Gaussians& gaussians, const Frame& frame) {
    if (frame.is_identity()) return;
    std::vector<float>& means = gaussians[Group::kMean].param;
    for (std::size_t i = 0; i < means.size(); ++i)
        means[i] = float(frame.scale * (double(means[i]) - frame.center[Eigen::Index(i % 3)]));
    const double log_scale = std::log(frame.scale);
    for (float& scale : gaussians[Group::kScale].param) scale = float(scale + log_scale);
}

}  // namespace gs
