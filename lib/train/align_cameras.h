// SPDX-License-Identifier: Apache-2.0
// Fits the poses of views to a finished model.
#pragma once

#include <vector>

#include "kernels/ranks/backend.h"
#include "lib/scene/scene.h"

namespace gs {

/// Views with other poses, and how far these are from the given ones.
struct AlignedViews {
    std::vector<View> views;
    std::vector<double> ssim{};  ///< of each view, as the loss has it
    double median_pixels = 0;    ///< median over the views of the root mean square over points of the scene
};

/// Returns the views with the poses at which a model looks most like their photographs, by L1 and SSIM with the default
/// weights. The model and the lenses stay as they are. Tries `steps` poses of each view, beginning with the given one
/// and following the gradient; none is farther away than about 12 pixels along each direction, or than
/// largest_correction(). Changes the optimizer's moments on the backend, so that no training may follow. Throws
/// DataError if an image cannot be read, and Interrupted after Ctrl-C.
AlignedViews align_cameras(Backend& backend, std::vector<View> views, const Vec3<float>& background, int steps);

}  // namespace gs
