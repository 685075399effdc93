// SPDX-License-Identifier: Apache-2.0
// Samples spherical harmonics on a lattice of directions, and fits them to the colours of any appearance.
#include "lib/export/sh_projection.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>

#include "appearance/contract.h"
#include "appearance/model_info.h"
#include "appearance/sh_basis.h"
#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/base/spherical_harmonics.h"

namespace gs {
namespace {

constexpr int kSampledDirections = 256;

/// Computes the colours of one Gaussian, one row per direction.
class Colors {
  public:
    explicit Colors(const Gaussians& g)
        : g_(g), info_(appearance_model(g.appearance.model)), shared_(g.shared.param.begin(), g.shared.param.end()) {
        if (!info_.residual)
            throw UsageError(fmt::format(
                "the appearance '{}' cannot be projected: the host cannot evaluate its residual", info_.name));
    }
    Eigen::MatrixX3d of(std::int64_t row, const std::vector<Vec3<double>>& at) const {
        const auto& residual = g_[Group::kResidual];
        const float* base = g_[Group::kBase].param.data() + 3 * row;
        const bool has_residual = row < g_.num_residuals();
        const auto first = residual.param.begin() + (has_residual ? row * residual.width : 0);
        const std::vector<double> params(first, first + (has_residual ? residual.width : 0));
        Eigen::MatrixX3d out(std::ptrdiff_t(at.size()), 3);
        for (std::size_t i = 0; i < at.size(); ++i) {
            const Vec3<double> y =
                Vec3<double>{base[0], base[1], base[2]} +
                info_.residual(shared_.data(), params.data(), at[i], has_residual ? g_.active_degree : 0);
            const ColorActivation phi = g_.appearance.activation;
            out.row(std::ptrdiff_t(i)) << color_activation(phi, y.x), color_activation(phi, y.y),
                color_activation(phi, y.z);
        }
        return out;
    }

  private:
    const Gaussians& g_;
    const ModelInfo& info_;
    const std::vector<double> shared_;
};

}  // namespace

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

ShProjection project_to_sh(const Gaussians& g, int degree) {
    const Colors colors(g);
    const auto fit_at = sphere_directions(kSampledDirections),
               check_at = sphere_directions(kSampledDirections, M_PI / 2);
    const Eigen::MatrixXd fit_basis = sh_basis_matrix(fit_at, degree), check_basis = sh_basis_matrix(check_at, degree);
    const Eigen::MatrixXd solve = fit_basis.completeOrthogonalDecomposition().pseudoInverse();

    ShProjection out;
    Gaussians& sh = out.gaussians;
    sh = g;
    sh.shared = {};
    sh.appearance = plain_sh_appearance(degree);
    sh.active_degree = degree;
    auto& rest = sh[Group::kResidual];
    rest.width = 3 * ((degree + 1) * (degree + 1) - 1);
    const std::int64_t num_residuals = g.num_rows(Group::kResidual);
    rest.param.assign(std::size_t(num_residuals * rest.width), 0.0f);
    std::vector<double> errors(static_cast<std::size_t>(g.count)), weights(static_cast<std::size_t>(g.count));
    parallel_for_rows(g.count, [&](std::int64_t i) {
        const Eigen::MatrixX3d coefficients = solve * (colors.of(i, fit_at).array() - 0.5).matrix();
        for (int c = 0; c < 3; ++c) {
            sh[Group::kBase].param[std::size_t(3 * i + c)] = float(kY0 * coefficients(0, c));
            for (int k = 1; k < coefficients.rows() && i < num_residuals; ++k)
                rest.param[std::size_t(i * rest.width + 3 * (k - 1) + c)] = float(coefficients(k, c));
        }
        const Eigen::MatrixX3d shown = ((check_basis * coefficients).array() + 0.5).cwiseMax(0.0);
        weights[std::size_t(i)] = sigmoid(double(g[Group::kOpacity].param[std::size_t(i)]));
        errors[std::size_t(i)] = (shown - colors.of(i, check_at)).squaredNorm() / double(shown.size());
    });
    double sum = 0, weight = 0;
    for (std::size_t i = 0; i < errors.size(); ++i) sum += weights[i] * errors[i], weight += weights[i];
    out.psnr = 10 * std::log10(weight / sum);
    return out;
}

}  // namespace gs
