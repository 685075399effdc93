// SPDX-License-Identifier: Apache-2.0
// The medians of one 16x16 tile on the CPU (docs/math/rasterizer.md#median).
#pragma once

#include "kernels/blend/blend_cpu.h"

namespace gs {

/// Writes the colour of each pixel's median to image, planar (3,H,W), for a tile that blend_tile processed before; 0
/// where transmittance stays above 1/2.
template <class Real>
void median_tile(const TileInput<Real>& in, std::int64_t num_processed, const std::uint16_t* block_masks, Real* image) {
    using L = Lanes<Real>;
    const BlockGeometry<Real> blocks(in.x0, in.y0);
    alignas(64) Real t[kTilePixels], r[kTilePixels] = {}, g[kTilePixels] = {}, b[kTilePixels] = {};
    std::fill_n(t, kTilePixels, Real(1));
    for (std::int64_t k = 0; k < num_processed; ++k) {
        const Splat<Real>& s = in.splats[in.instances[k].gaussian];
        const auto shape = FragmentShape<L>::from(s);
        const L cr(s.color.x), cg(s.color.y), cb(s.color.z);
        for (unsigned mask = block_masks[k]; mask; mask &= mask - 1) {
            const int block = __builtin_ctz(mask), at = block * kLanes;
            PixelForward<L> p{L::load(t + at), L::load(r + at), L::load(g + at), L::load(b + at)};
            pass_median<L, Real>(p, fragment_alpha(shape, blocks.px[block % 4], blocks.py[block / 4]).alpha, cr, cg, cb,
                                 in.cutoffs);
            p.t.store(t + at);
            p.r.store(r + at);
            p.g.store(g + at);
            p.b.store(b + at);
        }
    }
    const std::size_t plane = std::size_t(in.width) * in.height;
    for (int y = 0; y < std::min(kCpuTile, in.height - in.y0); ++y)
        for (int x = 0; x < std::min(kCpuTile, in.width - in.x0); ++x) {
            const int p = block_order(x, y);
            const std::size_t i = std::size_t(in.y0 + y) * in.width + in.x0 + x;
            image[i] = r[p], image[i + plane] = g[p], image[i + 2 * plane] = b[p];
        }
}

}  // namespace gs
