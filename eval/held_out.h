// SPDX-License-Identifier: Apache-2.0
// How far renders are from photographs, as they are and after a fit of their colours.
#pragma once

#include <vector>

#include "kernels/backend.h"
#include "lib/scene/scene.h"

namespace gs {

struct ViewErrors {
    double psnr = 0, aligned_psnr = 0;    ///< means over the views, dB
    double error = 0, aligned_error = 0;  ///< mean squared differences, mean over the views
};

/// Renders each view with neutral exposure and colour and compares it with its photograph, both kept in [0,1]. "Aligned" is after the affine map of
/// colours that fits the view best. Pixels that its mask leaves out do not count, nor does a view without any other. NaN without views.
/// Throws what View::load throws.
ViewErrors view_errors(Backend& backend, const std::vector<View>& views, const Vec3<float>& background);

}  // namespace gs
