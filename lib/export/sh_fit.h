// SPDX-License-Identifier: Apache-2.0
// Samples functions of the direction, to fit spherical harmonics to them.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "kernels/base/vec.h"

namespace gs {

/// Returns a Fibonacci lattice of unit vectors; `phase` turns it about its axis, radians.
std::vector<Vec3<double>> sphere_directions(int count, double phase = 0);

/// Returns the basis with one row per direction: Y_0 and the bands up to `degree` (0..3).
Eigen::MatrixXd sh_basis_matrix(const std::vector<Vec3<double>>& at, int degree);

}  // namespace gs
