// SPDX-License-Identifier: Apache-2.0
// What a model without view dependence leaves of photographs, taken apart: does it depend on the direction, on the
// image, or on neither?
#pragma once

#include <vector>

#include "eval/auto/photograph.h"
#include "kernels/ranks/backend.h"

namespace gs {

/// The shares of squared errors.
struct ResidualParts {
    double photometric = 0;  ///< what an affine map of colours takes off the error of each held-out photograph
    /// The share that a smooth function of the direction takes off the rest, over photographs that were trained on. The
    /// function is predicted at each place from all photographs but the one that it is tried on. The share is near 0 or
    /// below if there is nothing to learn.
    double direction = 0;
    double held_out_direction = 0;  ///< the same on held-out photographs; below 0 if images contradict each other
};

/// Divides space into cells of some pixels' size (beyond the cameras in inverse distance), takes the mean residual of
/// every cell in every photograph, and fits spherical harmonics of degree 3 to it over the directions a cell is seen
/// from. Differences inside a cell, such as detail that is not resolved yet, cancel in its mean, unlike in the errors
/// of a model that is trained. A share s of direction is worth -10 log10(1 - s) dB. `plain`: the backend of a model
/// without view dependence. `positions`: another backend of plain_sh_appearance(0), which positions are rendered with.
/// `seen`, `held_out`: at least one each. All zero if nothing is opaque.
ResidualParts residual_parts(Backend& plain, Backend& positions, const std::vector<Photograph>& seen,
                             const std::vector<Photograph>& held_out, const Vec3<float>& background);

}  // namespace gs
