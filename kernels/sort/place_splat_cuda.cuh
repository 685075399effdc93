// SPDX-License-Identifier: Apache-2.0
// Prepares a splat for the sort: the tiles that it reaches, and its key.
#pragma once

#include "kernels/sort/binning_cuda.h"

namespace gs {

/// The tiles that a lane's splat reaches. Each lane tests up to 32 candidates of its own splat; the warp shares the
/// rows of larger splats.
struct TileTest {
    unsigned mask;  ///< bits of the reached tiles among up to 32 candidates
    unsigned count;
};
__device__ inline TileTest test_tiles(const Splat<float>& s, const PixelBounds& b, bool valid, int tiles_x) {
    const TileRectangle r(b);
    TileTest out{0, 0};
    const bool large = valid && r.size() > 32;
    if (valid && !large) {
        const TileRows rows(s, r, tiles_x);
        for (int y = 0; y < r.height; ++y) {
            const TileRows::Span span = rows.row(r.y0 + y);
            if (span.size() > 0) out.mask |= (~0u >> (32 - span.size())) << (y * r.width + span.x0 - r.x0);
        }
        out.count = __popc(out.mask);
    }
    __syncwarp();
    for (unsigned owners = __ballot_sync(~0u, large); owners; owners &= owners - 1) {
        const int owner = __ffs(owners) - 1;
        const auto of_owner = [&](auto x) { return __shfl_sync(~0u, x, owner); };
        Splat<float> t{};
        t.mean = {of_owner(s.mean.x), of_owner(s.mean.y)};
        t.a = of_owner(s.a), t.b = of_owner(s.b), t.c = of_owner(s.c), t.threshold = of_owner(s.threshold);
        const PackedSplat p =
            PackedSplat::of(t, {of_owner(b.x_min), of_owner(b.x_max), of_owner(b.y_min), of_owner(b.y_max)});
        const TileRectangle q(p.bounds());
        unsigned count = 0;
        for (int y = q.y0; y < q.y0 + q.height; y += 32)
            count += __reduce_add_sync(~0u, unsigned(span_of_lane(p, y, q.y0 + q.height, tiles_x).size()));
        if (int(threadIdx.x & 31) == owner) out.count = count;
    }
    return out;
}

/// Writes a splat if it reaches a tile, and the input of binning for every splat, if it is sorted here.
__device__ inline void place_splat(std::int64_t i, const Splat<float>& s, const PixelBounds& b, const TileTest& tiles,
                                   const DepthKey& depth_key, float depth, PackedSplat* splats,
                                   const CudaBinningInput& out) {
    const bool visible = tiles.count > 0;
    if (visible) splats[i] = PackedSplat::of(s, b);
    out.counts[i] = tiles.count;
    if (!out.depth_keys) return;  // sorted elsewhere
    if (visible) out.spans[i] = TileSpan::of(TileRectangle(b), tiles.mask);
    // A depth computed by another kernel may be rounded to the wrong side of near; its key must not overflow into the
    // count.
    out.depth_keys[i] =
        visible ? min(depth_key(depth), kDepthKeyEnd) | min(tiles.count, kManyTiles) << kDepthKeyBits : 0;
}

/// Sets the counters of a view's stages to 0, in the first kernel of the view along with its work: a separate kernel
/// would take 2 us. Blocks must have at least kControlWords threads.
__device__ inline void begin_view(const CudaBinningInput& out, StepControl* control) {
    const std::size_t thread = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (thread < kControlWords) reinterpret_cast<unsigned*>(control)[thread] = 0;
    for (std::size_t k = thread; k < out.zeros.size(); k += std::size_t(gridDim.x) * blockDim.x) out.zeros[k] = {};
}

}  // namespace gs
