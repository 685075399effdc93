// SPDX-License-Identifier: Apache-2.0
// Samples spherical harmonics on a lattice of directions.
#include "lib/export/sh_fit.h"

#include <cmath>

#include "appearance/sh_basis.h"
#include "kernels/base/spherical_harmonics.h"

namespace gs {

std::vector<Vec3<double>> sphere_directions(int count, double phase) {
    std::vector<Vec3<double>> out;
    for (int i = 0; i < count; ++i) {
        const double y = 1 - (2 * i + 1.0) / count, r = std::sqrt(1 - y * y),
                     angle = M_PI * (3 - std::sqrt(5.0)) * i + phase;
        out.push_back({r * std::cos(angle), y, r * std::sin(angle)});
    }
    return out;
}

Eigen::MatrixXd sh_basis_matrix(const std::vector<Vec3<double>>& at, int degree) {
    Eigen::MatrixXd basis(std::ptrdiff_t(at.size()), (degree + 1) * (degree + 1));
    for (std::size_t i = 0; i < at.size(); ++i) {
        double y[16] = {kY0};
        appearance::ShBasis::basis(at[i], degree, y + 1);
        for (int k = 0; k < basis.cols(); ++k) basis(std::ptrdiff_t(i), k) = y[k];
    }
    return basis;
}

}  // namespace gs
