// SPDX-License-Identifier: Apache-2.0
// Scores the Gaussians of one 16x16 tile on the CPU (docs/math/densification.md#pruning-by-score).
#pragma once

#include "kernels/blend/blend_cpu.h"

namespace gs {

/// Writes the sums of (dI/dG)^2 over the tile's pixels to sums[slot], for the instances that blend_tile processed
/// before. image: planar (3,H,W); transmittance: (H,W).
template <class Real>
void score_tile(const TileInput<Real>& in, std::int64_t num_processed, const std::uint16_t* block_masks,
                const Real* image, const Real* transmittance, Real* sums) {
    using L = Lanes<Real>;
    const BlockGeometry<Real> blocks(in.x0, in.y0);
    alignas(64) Real t[kTilePixels] = {}, behind[kTilePixels] = {}, background[kTilePixels] = {};
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < std::min(kCpuTile, in.height - in.y0); ++y)
        for (int x = 0; x < std::min(kCpuTile, in.width - in.x0); ++x) {
            const int p = block_order(x, y);
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            const auto pixel = PixelScore<Real>::of(Vec3<Real>{image[i], image[i + plane], image[i + 2 * plane]},
                                                    transmittance[i], in.background);
            t[p] = pixel.t, behind[p] = pixel.behind, background[p] = pixel.background;
        }
    for (std::int64_t k = 0; k < in.num_instances; ++k) {
        const Splat<Real>& s = in.splats[in.instances[k].gaussian];
        const auto shape = FragmentShape<L>::from(s);
        const L color_sum(s.color.x + s.color.y + s.color.z);
        L sum(Real(0));
        for (unsigned mask = k < num_processed ? block_masks[k] : 0; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelScore<L> p{L::load(t + at), L::load(behind + at), L::load(background + at)};
            const L alpha = fragment_alpha(shape, blocks.px[block % 4], blocks.py[block / 4]).alpha;
            sum = sum + fragment_score<L, Real>(p, alpha, shape.opacity, color_sum, in.cutoffs);
            p.t.store(t + at);
            p.behind.store(behind + at);
        }
        sums[in.instances[k].slot] = sum_lanes(sum);
    }
}

}  // namespace gs
