// SPDX-License-Identifier: Apache-2.0
// Projects any appearance to spherical harmonics by sampling directions, for programs that support nothing else.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "kernels/base/vec.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns a Fibonacci lattice of unit vectors, rotated about its axis by `phase` radians.
std::vector<Vec3<double>> sphere_directions(int count, double phase = 0);

/// Returns the basis with one row per direction: Y_0 and the bands up to `degree` (0..3).
Eigen::MatrixXd sh_basis_matrix(const std::vector<Vec3<double>>& at, int degree);

struct ShProjection {
    Gaussians gaussians;  ///< least-squares fit of the colours, plain_sh_appearance(degree)
    /// 10 log10(1/MSE) of the colours that a reader displays, weighted by opacity, over directions between the
    /// directions of the fit. Infinite if nothing is visible.
    double psnr = 0;
};

/// Fits the visible colour, phi(base + residual), of each Gaussian over 256 directions spread evenly over the sphere.
/// Bands above `degree` (0..3) are lost. Cost: 512 evaluations of the residual per Gaussian. Throws UsageError if the
/// host cannot evaluate the model's residual.
ShProjection project_to_sh(const Gaussians& gaussians, int degree);

}  // namespace gs
