// SPDX-License-Identifier: Apache-2.0
// Projects any appearance to spherical harmonics, for programs that know only these, by samples of the direction.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "kernels/base/vec.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

/// Returns a Fibonacci lattice of unit vectors; `phase` turns it about its axis, radians.
std::vector<Vec3<double>> sphere_directions(int count, double phase = 0);

/// Returns the basis with one row per direction: Y_0 and the bands up to `degree` (0..3).
Eigen::MatrixXd sh_basis_matrix(const std::vector<Vec3<double>>& at, int degree);

struct ShProjection {
    Gaussians gaussians;  ///< plain_sh_appearance(degree): the colours' least-squares fit
    /// 10 log10(1/MSE) of the colours that a reader shows, weighted by opacity, over directions between those of the
    /// fit. Infinite when there is nothing to show.
    double psnr = 0;
};

/// Fits the visible colour, phi(base + residual), of each Gaussian over 256 directions spread evenly over the sphere.
/// The part beyond `degree` (0..3) bands is lost. Cost: 512 evaluations of the residual per Gaussian. Throws UsageError
/// for a model whose residual the host cannot evaluate.
ShProjection project_to_sh(const Gaussians& gaussians, int degree);

}  // namespace gs
