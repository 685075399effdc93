// SPDX-License-Identifier: Apache-2.0
// The SGLD noise that explores positions (docs/math/densification.md#noise).
#pragma once

#include "kernels/base/rng.h"
#include "kernels/splat/projection_device.h"

namespace gs {

/// Returns the displacement of a mean: factor * sigmoid(0.5 - 100 o) * Sigma * xi. xi is standard normal and keyed on
/// (seed, iteration, index). The displacement is zero where it could not change the mean in float, and for degenerate
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

}  // namespace gs
