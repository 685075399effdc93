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
    double median_pixels = 0;  ///< median over the views of the root mean square over points of the scene
};

/// Returns the test views of a scene with the poses at which a model looks most like their photographs, by the loss of
/// the training. The model and the lenses stay as they are. Changes the optimizer's moments on the backend, so that no
/// training may follow. Throws DataError if an image cannot be read.
AlignedViews align_test_cameras(Backend& backend, const Scene& scene, const Vec3<float>& background);

}  // namespace gs
