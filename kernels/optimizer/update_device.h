// SPDX-License-Identifier: Apache-2.0
// The optimizer step of one Gaussian: regularisers, guard against non-finite gradients, Adam on every group, noise.
#pragma once

#include "kernels/densify/relocation_device.h"
#include "kernels/optimizer/adam_device.h"
#include "kernels/preprocess/gaussian_device.h"

namespace gs {

/// Columns that may have rates of their own. Bounded so that a kernel takes them as a parameter.
inline constexpr int kMaxResidualColumns = 96;

/// What all Gaussians share in one step. Plain data, passed to kernels by value.
struct UpdateArgs {
    AdamStep<float> steps[kNumGroups];
    bool per_column;                       ///< residual_steps holds one per residual column; else steps[kResidual] is for all
    AdamStep<float> residual_steps[kMaxResidualColumns];
    float opacity_gradient;                ///< lambda_o / N
    float scale_gradient;                  ///< lambda_s / 3N
    float noise;                           ///< SGLD factor, 0 = none
    std::uint64_t seed, iteration;
    int width, height;                     ///< of the view, for the ADC statistic
};

/// Where the rows of all groups are.
struct ModelArrays {
    float *param[kNumGroups], *m[kNumGroups], *v[kNumGroups];
    int width[kNumGroups];
    float *gradient_sum, *gradient_count; ///< ADC statistic, or null
};

GS_HD bool is_finite(const GaussianGradient<float>& g, const float* dL_dresidual, int residual_width) {
    // x - x is 0 for finite x and NaN otherwise; NaN survives the sum.
    const auto& q = g.geometry;
    const auto zero = [](float x) { return x - x; };
    float s = zero(q.mean.x) + zero(q.mean.y) + zero(q.mean.z) + zero(q.log_scale.x) + zero(q.log_scale.y) + zero(q.log_scale.z) + zero(q.raw_opacity) +
              zero(q.rotation.x) + zero(q.rotation.y) + zero(q.rotation.z) + zero(q.rotation.w) + zero(g.base.x) + zero(g.base.y) + zero(g.base.z);
    for (int k = 0; k < residual_width; ++k) s += zero(dL_dresidual[k]);
    return s == 0;
}

/// Zeroes a gradient that is not finite, and then returns false: one bad value would stay in the moments for ever.
GS_HD bool drop_nonfinite(GaussianGradient<float>& g, float* dL_dresidual, int residual_width) {
    if (!g.visible || is_finite(g, dL_dresidual, residual_width)) return true;
    g = GaussianGradient<float>{};
    for (int k = 0; k < residual_width; ++k) dL_dresidual[k] = 0;
    return false;
}

/// One step of everything but the residual of Gaussian i, whose data gradient is `g` (finite; zero where invisible).
GS_HD void update_gaussian(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, GaussianGradient<float>& g) {
    if (g.visible && a.gradient_sum) {
        const float x = 0.5f * u.width * g.mean2d.x, y = 0.5f * u.height * g.mean2d.y;
        a.gradient_sum[i] += gs_sqrt(x * x + y * y);
        a.gradient_count[i] += 1.0f;
    }
    // Regularisers: means over all Gaussians, visible or not.
    const float* s = a.param[int(Group::kScale)] + 3 * i;
    if (u.opacity_gradient > 0) {
        const float o = sigmoid(a.param[int(Group::kOpacity)][i]);
        g.geometry.raw_opacity += u.opacity_gradient * o * (1 - o);
    }
    if (u.scale_gradient > 0) {
        const auto scale = [&](float x) { return u.scale_gradient * gs_exp(gs_min(x, float(kMaxLogScale))); };
        g.geometry.log_scale += Vec3<float>{scale(s[0]), scale(s[1]), scale(s[2])};
    }
    const auto step = [&](Group group, int column, float gradient, const AdamStep<float>& t) {
        const int k = int(group);
        const std::int64_t at = i * a.width[k] + column;
        adam_update(a.param[k][at], a.m[k][at], a.v[k][at], gradient, t);
    };
    const auto& q = g.geometry;
    const auto three = [&](Group group, const Vec3<float>& d) {
        const AdamStep<float> t = u.steps[int(group)];
        step(group, 0, d.x, t), step(group, 1, d.y, t), step(group, 2, d.z, t);
    };
    three(Group::kMean, q.mean);
    three(Group::kScale, q.log_scale);
    three(Group::kBase, g.base);
    const AdamStep<float> tr = u.steps[int(Group::kRotation)];
    step(Group::kRotation, 0, q.rotation.x, tr), step(Group::kRotation, 1, q.rotation.y, tr);
    step(Group::kRotation, 2, q.rotation.z, tr), step(Group::kRotation, 3, q.rotation.w, tr);
    step(Group::kOpacity, 0, q.raw_opacity, u.steps[int(Group::kOpacity)]);
    if (u.noise > 0) {
        float* mean = a.param[int(Group::kMean)] + 3 * i;
        const float* r = a.param[int(Group::kRotation)] + 4 * i;
        const GaussianGeometry<float> now{{mean[0], mean[1], mean[2]}, {s[0], s[1], s[2]}, {r[0], r[1], r[2], r[3]}, a.param[int(Group::kOpacity)][i]};
        const Vec3<float> d = sgld_noise(now, u.noise, u.seed, u.iteration, std::uint32_t(i));
        mean[0] += d.x, mean[1] += d.y, mean[2] += d.z;
    }
}

/// One step of the residual of Gaussian i.
GS_HD void update_residual(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, const float* dL_dresidual) {
    const int k = int(Group::kResidual), width = a.width[k];
    float *p = a.param[k] + i * width, *m = a.m[k] + i * width, *v = a.v[k] + i * width;
    if (u.per_column) {
        for (int c = 0; c < width; ++c) adam_update(p[c], m[c], v[c], dL_dresidual[c], u.residual_steps[c]);
        return;
    }
    const AdamStep<float> t = u.steps[k];
#if !defined(__CUDACC__)
#pragma omp simd
#endif
    for (int c = 0; c < width; ++c) adam_update(p[c], m[c], v[c], dL_dresidual[c], t);
}

/// The factors of Adam's step `t` for a request.
inline UpdateArgs update_args(const StepRequest& r, std::int64_t t, std::int64_t num_gaussians) {
    UpdateArgs u{};
    for (int g = 0; g < kNumGroups; ++g) u.steps[g] = AdamStep<float>::at(r.rates[g], t);
    u.opacity_gradient = r.opacity_reg / float(num_gaussians);
    u.scale_gradient = r.scale_reg / (3 * float(num_gaussians));
    u.noise = r.noise, u.seed = r.seed, u.iteration = std::uint64_t(r.iteration);
    u.width = r.camera.width, u.height = r.camera.height;
    u.per_column = !r.residual_rates.empty();
    for (std::size_t c = 0; c < r.residual_rates.size(); ++c) u.residual_steps[c] = AdamStep<float>::at(r.residual_rates[c], t);
    return u;
}

}  // namespace gs
