// SPDX-License-Identifier: Apache-2.0
// Any appearance as spherical harmonics, for programs that know nothing else.
#pragma once

#include "kernels/model/gaussian_state.h"

namespace gs {

struct ShProjection {
    Gaussians gaussians;  ///< plain_sh_appearance(degree): the colours' least-squares fit
    /// 10 log10(1/MSE) of the colours that a reader shows, over directions between those of the fit, weighted by opacity; infinite
    /// where there is nothing to show.
    double psnr = 0;
};

/// Fits the visible colour, phi(base + residual), of each Gaussian over 256 directions spread evenly over the sphere: what cannot be
/// said in `degree` (0..3) bands is lost. Cost: 512 evaluations of the residual per Gaussian. Throws UsageError for a model that does not
/// give its residual to the host.
ShProjection project_to_sh(const Gaussians& gaussians, int degree);

}  // namespace gs
