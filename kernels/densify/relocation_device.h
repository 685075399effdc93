// SPDX-License-Identifier: Apache-2.0
// Opacity and scale of Gaussians that share one Gaussian's place, and the SGLD noise (densification spec 1.3, 1.4).
#pragma once

#include "kernels/core/rng.h"
#include "kernels/preprocess/preprocess_device.h"

namespace gs {

/// Copies beyond this many at one place are not accounted for (limit of the reference's table).
inline constexpr int kMaxRelocationCopies = 50;

struct Relocated {
    double opacity;     ///< of each copy, not clamped
    double scale_factor; ///< linear scales are multiplied by this
};

/// n copies that together look like one Gaussian of this opacity (MCMC paper Eq. 9; the double sum collapses to one by
/// the hockey-stick identity). In double: the alternating sum loses up to 4e-4 in float at n = 50.
GS_HD Relocated relocate(double opacity, int n) {
    const double o = gs_min(opacity, 1 - 1.1920928955078125e-7); // 1 exactly would cancel completely
    n = n < 1 ? 1 : (n > kMaxRelocationCopies ? kMaxRelocationCopies : n);
    const double shared = -gs_expm1(gs_log1p(-o) / n);
    double sum = 0, binomial = 1, power = 1;
    for (int k = 1; k <= n; ++k) {
        binomial *= double(n - k + 1) / k;
        power *= shared;
        sum += (k % 2 ? 1.0 : -1.0) * binomial * power / gs_sqrt(double(k));
    }
    if (!(sum > 1e-12)) return {opacity, 1.0};
    return {shared, o / sum};
}

/// Displacement of a mean: factor * sigmoid(0.5 - 100 o) * Sigma * xi, xi standard normal, keyed on (seed, iteration,
/// index). Zero where it could not change the mean in float, and for degenerate rotations.
GS_HD Vec3<float> sgld_noise(const GaussianGeometry<float>& g, float factor, std::uint64_t seed, std::uint64_t iteration, std::uint32_t index) {
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

}  // namespace gs
