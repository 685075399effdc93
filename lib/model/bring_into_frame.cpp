// SPDX-License-Identifier: Apache-2.0
// Moves means and scales into a frame.
#include "lib/model/bring_into_frame.h"

#include "lib/scene/frame.h"

namespace gs {

void bring_into_frame(Gaussians& gaussians, const Frame& frame) {
    if (frame.is_identity()) return;
    const FileCoordinates scene{frame};
    std::vector<float>& means = gaussians[Group::kMean].param;
    for (std::size_t i = 0; i < means.size(); ++i) means[i] = float(scene.from_file(means[i], int(i % 3)));
    for (float& scale : gaussians[Group::kScale].param) scale = float(scene.size_from_file(scale));
}

}  // namespace gs
