// SPDX-License-Identifier: Apache-2.0
// Value of a Gaussian's residual for all training views (docs/math/residuals.md).
//
// It is computed from two sums of the backward pass per view and Gaussian: G, the gradient of half the squared error by
// the Gaussian's colour, and W, the sum of its blending weights, which approximates the curvature if neighbours change
// alike.
#pragma once

#include <vector>

#include "appearance/contract.h"
#include "kernels/base/vec.h"
#include "kernels/requests.h"

namespace gs {

/// The sums of a Gaussian over the views that show it.
struct ResidualSums {
    float weight, change[3], change_squared, gradient[3], gradient_change;

    /// Adds a view in which the Gaussian has colour `full`, and would have colour `base` without its residual.
    GS_HD void add(float w, const Vec3<float>& dL_dcolor, const Vec3<float>& full, const Vec3<float>& base) {
        const float g[3] = {dL_dcolor.x, dL_dcolor.y, dL_dcolor.z},
                    r[3] = {full.x - base.x, full.y - base.y, full.z - base.z};
        weight += w;
        for (int k = 0; k < 3; ++k) {
            change[k] += w * r[k], change_squared += w * r[k] * r[k];
            gradient[k] += g[k], gradient_change += g[k] * r[k];
        }
    }
    /// Returns the increase of the error if the Gaussian has its mean colour from all directions.
    GS_HD float worth() const {
        if (!(weight > 0)) return 0;
        float mean_squared = 0, mean_gradient = 0;
        for (int k = 0; k < 3; ++k)
            mean_squared += change[k] * change[k] / weight, mean_gradient += gradient[k] * change[k] / weight;
        return 0.5f * (change_squared - mean_squared) - (gradient_change - mean_gradient);
    }
    /// Returns the base colour that reproduces the mean colour of a Gaussian. `base` is its current base colour, which
    /// is returned if no view shows the Gaussian.
    GS_HD Vec3<float> mean_base(ColorActivation activation, const Vec3<float>& base) const {
        if (!(weight > 0)) return base;
        const Vec3<float> shown = activate(activation, base);
        return {inverse(activation, shown.x + change[0] / weight), inverse(activation, shown.y + change[1] / weight),
                inverse(activation, shown.z + change[2] / weight)};
    }

  private:
    /// Inverts the activation. Above 1, which only unbounded activations reach, they just add 0.5.
    GS_HD static float inverse(ColorActivation activation, float color) {
        const bool unbounded = activation == ColorActivation::kRelu || activation == ColorActivation::kSoftplus;
        return unbounded && color >= 1 ? color - 0.5f : inverse_color_activation(activation, color);
    }
};

/// Returns the scores of all Gaussians, of which the first ones have sums. `bases` (n,3): the base colours.
inline ResidualScores residual_scores_of(const std::vector<ResidualSums>& sums, ColorActivation activation,
                                         std::vector<float> bases) {
    ResidualScores out{std::vector<float>(bases.size() / 3, 0.0f), std::move(bases)};
    for (std::size_t i = 0; i < sums.size(); ++i) {
        float* base = &out.mean_base[3 * i];
        const Vec3<float> mean = sums[i].mean_base(activation, {base[0], base[1], base[2]});
        base[0] = mean.x, base[1] = mean.y, base[2] = mean.z;
        out.worth[i] = sums[i].worth();
    }
    return out;
}

}  // namespace gs
