// SPDX-License-Identifier: Apache-2.0
// What the residual of a Gaussian is worth to all training views (docs/math/residuals.md).
//
// It comes from two sums of the backward pass per view and Gaussian: G, the gradient of half the squared error by the
// Gaussian's colour, and W, the sum of its blending weights, which stands for the curvature if neighbours change alike.
#pragma once

#include <vector>

#include "appearance/contract.h"
#include "kernels/core/vec.h"

namespace gs {

/// The sums of a Gaussian over the views that show it.
struct ResidualSums {
    float weight, color[3], change[3], change_squared, gradient[3], gradient_change;

    /// Adds a view that shows the Gaussian in `color`, and would show it in `base` without its residual.
    GS_HD void add(float w, const Vec3<float>& dL_dcolor, const Vec3<float>& full, const Vec3<float>& base) {
        const float g[3] = {dL_dcolor.x, dL_dcolor.y, dL_dcolor.z}, c[3] = {full.x, full.y, full.z},
                    r[3] = {full.x - base.x, full.y - base.y, full.z - base.z};
        weight += w;
        for (int k = 0; k < 3; ++k) {
            color[k] += w * c[k];
            change[k] += w * r[k], change_squared += w * r[k] * r[k];
            gradient[k] += g[k], gradient_change += g[k] * r[k];
        }
    }
    /// Returns by how much the error grows if the Gaussian is seen in its mean colour from everywhere.
    GS_HD float worth() const {
        if (!(weight > 0)) return 0;
        float mean_squared = 0, mean_gradient = 0;
        for (int k = 0; k < 3; ++k)
            mean_squared += change[k] * change[k] / weight, mean_gradient += gradient[k] * change[k] / weight;
        return 0.5f * (change_squared - mean_squared) - (gradient_change - mean_gradient);
    }
    /// Returns the base colour that shows the mean colour; `base` where no view shows the Gaussian.
    GS_HD Vec3<float> mean_base(ColorActivation activation, const Vec3<float>& base) const {
        if (!(weight > 0)) return base;
        return {inverse(activation, color[0] / weight), inverse(activation, color[1] / weight),
                inverse(activation, color[2] / weight)};
    }

  private:
    /// Beyond 1, where only some activations reach, these only add a half.
    GS_HD static float inverse(ColorActivation activation, float color) {
        const bool unbounded = activation == ColorActivation::kRelu || activation == ColorActivation::kSoftplus;
        return unbounded && color >= 1 ? color - 0.5f : inverse_color_activation(activation, color);
    }
};

}  // namespace gs
