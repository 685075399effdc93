// SPDX-License-Identifier: Apache-2.0
// Decomposes the error of a model without view dependence into parts that depend on the direction, on the image, or on
// neither.
#pragma once

#include <vector>

#include "eval/auto/photograph.h"
#include "kernels/ranks/backend.h"

namespace gs {

/// Shares of squared errors.
struct ResidualParts {
    double photometric = 0;  ///< share removed from the error of each held-out photograph by an affine colour map
    /// Share of the remaining error that a smooth function of the direction removes, over photographs that were trained
    /// on. The function is predicted at each place from all photographs except the one it is tested on. The share is
    /// near 0 or below if there is nothing to learn.
    double direction = 0;
    double held_out_direction = 0;  ///< the same share on held-out photographs; below 0 if images contradict each other
};

/// Divides space into cells a few pixels in size (beyond the cameras in inverse distance), computes for every
/// photograph the mean residual of every cell, and fits spherical harmonics of degree 3 to it over the directions from
/// which a cell is seen. Differences inside a cell, such as unresolved detail, cancel in its mean, unlike in the errors
/// of a trained model. A share s of direction is worth -10 log10(1 - s) dB. `plain`: the backend of a model without
/// view dependence. `positions`: another backend of plain_sh_appearance(0), which renders positions. `seen`,
/// `held_out`: at least one each. All shares are zero if nothing is opaque.
ResidualParts residual_parts(Backend& plain, Backend& positions, const std::vector<Photograph>& seen,
                             const std::vector<Photograph>& held_out, const Vec3<float>& background);

}  // namespace gs
