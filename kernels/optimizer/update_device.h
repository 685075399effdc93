// SPDX-License-Identifier: Apache-2.0
// The optimizer step of one Gaussian: regularisers, a guard against non-finite gradients, Adam on every group, and
// noise.
#pragma once

#include "kernels/base/rng.h"
#include "kernels/requests.h"
#include "kernels/splat/gaussian_rows_device.h"
#include "kernels/splat/projection_device.h"
#include "kernels/state/adam_device.h"
#include "kernels/state/gaussian_state.h"

namespace gs {

// The SGLD noise for exploring positions (docs/math/densification.md#noise).

/// Returns the displacement of a mean: factor * sigmoid(0.5 - 100 o) * Sigma * xi. xi is standard normal and keyed on
/// (seed, iteration, index). The displacement is zero if it could not change the mean in float, and for degenerate
/// rotations.
GS_HD Vec3<float> sgld_noise(const GaussianGeometry<float>& g, float factor, std::uint64_t seed,
                             std::uint64_t iteration, std::uint32_t index) {
    const float gate = factor * sigmoid(0.5f - 100.0f * sigmoid(g.raw_opacity));
    const Vec3<float> var = activated_variance(g.log_scale);
    const float reach = gate * gs_max(var.x, gs_max(var.y, var.z));
    const float size = gs_max(gs_abs(g.mean.x), gs_max(gs_abs(g.mean.y), gs_abs(g.mean.z)));
    if (!(reach > 1e-9f * size) || !usable_rotation(g.rotation)) return {0, 0, 0};
    float xi[4];
    normals_from(philox(seed, RngStream::kNoise, iteration, index), xi);
    const Mat3<float> r = rotation_matrix(g.rotation);
    return (r * (r.transposed_times({xi[0], xi[1], xi[2]}) * var)) * gate;
}

/// Largest number of columns with separate rates. It is bounded so that it fits into kernel parameters.
inline constexpr int kMaxResidualColumns = 96;

/// Largest number of missed views for which a Gaussian catches up. Without a bound it could leap: its second moments
/// vanish, while its first moments remain.
inline constexpr float kMostMissed = 1000;

/// The values common to all Gaussians in one step. They are plain data, passed to kernels by value.
struct UpdateArgs {
    AdamStep<float> steps[kNumGroups];
    bool per_column;  ///< whether each residual column has its own residual_steps entry
    AdamStep<float> residual_steps[kMaxResidualColumns];
    AdamStep<float> shared_step;  ///< step of the shared weights
    AdamGains<float> gains, shared_gains;
    float opacity_gradient;  ///< lambda_o / N
    float scale_gradient;    ///< lambda_s / 3N
    Vec3<float> center;      ///< mean of the cameras; this and the next two as in StepRequest
    float extent, far_rate;
    float noise;  ///< SGLD factor, 0 = none
    std::uint64_t seed, iteration;
    int width, height;  ///< size of the view, for the ADC statistic
    float step, views;  ///< Adam's step after this update, which applies `views` of them at once

    /// Returns the number of steps, possibly fractional, that Gaussian i takes now; 0 if it is deferred. If only
    /// visible Gaussians take steps, the number includes the steps that it missed.
    GS_HD float turns(const ModelArrays& a, std::int64_t i, bool visible) const {
        if (!a.last_step) return 1;
        return visible ? 1 + gs_min(step - views - a.last_step[i], kMostMissed) / views : 0.0f;
    }
    /// Returns the decay factor of a Gaussian's second moments before it takes `turns` steps at once. First moments do
    /// not decay: their effect has not been applied yet.
    GS_HD float decay(float turns) const { return second_moment_decay((turns - 1) * views); }
};

/// One row of a group with its moments.
template <int kWidth> struct Row {
    Group group;
    float p[kWidth], m[kWidth], v[kWidth];

    GS_HD Row(const ModelArrays& a, Group row_group, std::int64_t i) : group(row_group) {
        const std::int64_t at = i * kWidth;
        const int k = int(group);
        GS_UNROLL
        for (int c = 0; c < kWidth; ++c) p[c] = a.param[k][at + c], m[c] = a.m[k][at + c], v[c] = a.v[k][at + c];
    }
    GS_HD void age(float decay) {
        GS_UNROLL
        for (int c = 0; c < kWidth; ++c) v[c] *= decay;
    }
    GS_HD void step(const UpdateArgs& u, const float (&gradient)[kWidth]) { step(u, u.steps[int(group)], gradient); }
    GS_HD void step(const UpdateArgs& u, const AdamStep<float>& t, const float (&gradient)[kWidth]) {
        GS_UNROLL
        for (int c = 0; c < kWidth; ++c) adam_update(p[c], m[c], v[c], gradient[c], t, u.gains);
    }
    GS_HD void write(const ModelArrays& a, std::int64_t i) const {
        const std::int64_t at = i * kWidth;
        const int k = int(group);
        GS_UNROLL
        for (int c = 0; c < kWidth; ++c) a.param[k][at + c] = p[c], a.m[k][at + c] = m[c], a.v[k][at + c] = v[c];
    }
};

GS_HD bool is_finite(const GaussianGradient<float>& g, const float* dL_dresidual, int residual_width) {
    // x - x is 0 for finite x and NaN otherwise. NaN survives the sum.
    const auto& q = g.geometry;
    const auto zero = [](float x) { return x - x; };
    const float s = zero(q.mean.x) + zero(q.mean.y) + zero(q.mean.z) + zero(q.log_scale.x) + zero(q.log_scale.y) +
                    zero(q.log_scale.z) + zero(q.raw_opacity) + zero(q.rotation.x) + zero(q.rotation.y) +
                    zero(q.rotation.z) + zero(q.rotation.w) + zero(g.base.x) + zero(g.base.y) + zero(g.base.z);
    int broken = s != 0;  // not summed: a sum's fixed order would prevent vectorization
    for (int k = 0; k < residual_width; ++k) broken |= !gs_isfinite(dL_dresidual[k]);
    return broken == 0;
}

/// Zeroes a gradient that is not finite, and then returns false. A single such value would stay in the moments for
/// ever. The Gaussian stays visible.
GS_HD bool drop_nonfinite(GaussianGradient<float>& g, float* dL_dresidual, int residual_width) {
    if (!g.visible || is_finite(g, dL_dresidual, residual_width)) return true;
    g = GaussianGradient<float>{};
    g.visible = true;
    for (int k = 0; k < residual_width; ++k) dL_dresidual[k] = 0;
    return false;
}

/// Returns the step of a mean at p. It is scaled so that far means move across as many pixels as near ones.
GS_HD AdamStep<float> mean_step(const UpdateArgs& u, const float (&p)[3]) {
    AdamStep<float> step = u.steps[int(Group::kMean)];
    if (u.far_rate > 0) {
        const Vec3<float> from_center = Vec3<float>{p[0], p[1], p[2]} - u.center;
        const float far = gs_sqrt(dot(from_center, from_center)) / u.extent;
        if (far > 1) step.step_size *= gs_pow(far, u.far_rate);
    }
    return step;
}

/// Adds the gradient of one view, which must be finite, to the statistic of ADC.
GS_HD void add_gradient_statistic(const ModelArrays& a, int width, int height, std::int64_t i,
                                  const GaussianGradient<float>& g) {
    if (!g.visible || !a.gradient_sum) return;
    const float x = 0.5f * width * g.mean2d.x, y = 0.5f * height * g.mean2d.y;
    a.gradient_sum[i] += gs_sqrt(x * x + y * y);
    a.gradient_count[i] += 1.0f;
}

/// Takes one step of Gaussian i except for its residual, if `turns` (UpdateArgs::turns) is above 0. Second moments,
/// regularisers and noise get the effect of all of these steps. `g` is its data gradient (finite; zero if invisible).
/// At the end it calls write(row) for each group's row.
template <class Write>
GS_HD void update_gaussian(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, float turns,
                           GaussianGradient<float>& g, Write&& write) {
    const bool moves = turns > 0;
    if (moves && u.opacity_gradient > 0) {
        const float o = sigmoid(a.param[int(Group::kOpacity)][i]);
        g.geometry.raw_opacity += u.opacity_gradient * turns * o * (1 - o);
    }
    if (moves && u.scale_gradient > 0) {
        const float* s = a.param[int(Group::kScale)] + 3 * i;
        const float weight = u.scale_gradient * turns;
        const auto gradient = [&](float x) { return weight * gs_exp(gs_min(x, float(kMaxLogScale))); };
        g.geometry.log_scale += Vec3<float>{gradient(s[0]), gradient(s[1]), gradient(s[2])};
    }
    // All rows are read before any is written. Otherwise each read would wait for earlier writes.
    const auto& q = g.geometry;
    Row<3> mean(a, Group::kMean, i), scale(a, Group::kScale, i), base(a, Group::kBase, i);
    Row<4> rotation(a, Group::kRotation, i);
    Row<1> opacity(a, Group::kOpacity, i);
    if (turns > 1) {
        const float decay = u.decay(turns);
        mean.age(decay), scale.age(decay), rotation.age(decay), opacity.age(decay), base.age(decay);
    }
    if (moves) {
        mean.step(u, mean_step(u, mean.p), {q.mean.x, q.mean.y, q.mean.z});
        scale.step(u, {q.log_scale.x, q.log_scale.y, q.log_scale.z});
        rotation.step(u, {q.rotation.x, q.rotation.y, q.rotation.z, q.rotation.w});
        opacity.step(u, {q.raw_opacity});
        opacity.p[0] = gs_min(float(kMaxRawOpacity), opacity.p[0]);  // NaN stays NaN, so that pruning finds it
        base.step(u, {g.base.x, g.base.y, g.base.z});
    }
    if (moves && u.noise > 0) {
        const GaussianGeometry<float> now{{mean.p[0], mean.p[1], mean.p[2]},
                                          {scale.p[0], scale.p[1], scale.p[2]},
                                          {rotation.p[0], rotation.p[1], rotation.p[2], rotation.p[3]},
                                          opacity.p[0]};
        const Vec3<float> d = sgld_noise(now, u.noise * gs_sqrt(turns), u.seed, u.iteration, std::uint32_t(i));
        mean.p[0] += d.x, mean.p[1] += d.y, mean.p[2] += d.z;
    }
    write(mean), write(scale), write(rotation), write(opacity), write(base);
    if (moves && a.last_step) a.last_step[i] = u.step;
}
GS_HD void update_gaussian(const ModelArrays& a, const UpdateArgs& u, std::int64_t i, float turns,
                           GaussianGradient<float>& g) {
    if (turns > 0) update_gaussian(a, u, i, turns, g, [&](const auto& row) { row.write(a, i); });
}

/// Takes one step of a shared weight with the gradient summed over all Gaussians. Returns false if the gradient is not
/// finite; it then counts as 0.
GS_HD bool update_shared(float& p, float& m, float& v, float gradient, const AdamStep<float>& step,
                         const AdamGains<float>& gains) {
    const bool finite = gs_isfinite(gradient);
    adam_update(p, m, v, finite ? gradient : 0.0f, step, gains);
    p = gs_clamp(p, -float(kLargestSharedWeight), float(kLargestSharedWeight));
    return finite;
}

/// Returns the sum of value `k` over the rows (num_rows, width), added up in row order.
GS_HD float sum_of_rows(const float* rows, int num_rows, int width, int k) {
    double sum = 0;
    for (int row = 0; row < num_rows; ++row) sum += rows[row * width + k];
    return float(sum);
}

/// Returns the arguments of Adam's step `t` for a request. The step covers `views` of Adam's steps at once.
inline UpdateArgs update_args(const StepRequest& r, std::int64_t t, std::int64_t num_gaussians, int views = 1) {
    UpdateArgs u{};
    for (int g = 0; g < kNumGroups; ++g) u.steps[g] = AdamStep<float>::at(r.rates.groups[g], t);
    u.opacity_gradient = r.loss.opacity_reg / float(num_gaussians);
    u.scale_gradient = r.loss.scale_reg / (3 * float(num_gaussians));
    u.center = r.rates.center, u.extent = r.rates.extent, u.far_rate = r.rates.far;
    u.shared_step = AdamStep<float>::at(r.rates.shared, t, kAdamBeta2Shared);
    u.gains = AdamGains<float>::of(views), u.shared_gains = AdamGains<float>::of(views, kAdamBeta2Shared);
    u.noise = r.rates.noise, u.seed = r.seed, u.iteration = std::uint64_t(r.iteration);
    u.width = r.camera.width, u.height = r.camera.height;
    u.step = float(t), u.views = float(views);
    u.per_column = !r.rates.residuals.empty();
    for (std::size_t c = 0; c < r.rates.residuals.size(); ++c)
        u.residual_steps[c] = AdamStep<float>::at(r.rates.residuals[c], t);
    return u;
}

}  // namespace gs
