// SPDX-License-Identifier: Apache-2.0
// The layout of threads, pixels and batches of splats in the blend kernels. Only the .cu files of this folder include
// it.
#pragma once

#include "kernels/blend/blend_cuda.h"

namespace gs {

__device__ inline int2 tile_corner(int tile, int tiles_x) {
    return {tile % tiles_x * kCudaTileX, tile / tiles_x * kCudaTileY};
}
/// Returns the first pixel of a warp's sub-tile. A tile has three rows of two sub-tiles.
__device__ inline int2 sub_tile_corner(int2 tile_corner, int warp) {
    return {tile_corner.x + (warp & 1) * kSubX, tile_corner.y + (warp >> 1) * kSubY};
}
__device__ inline int2 pixel_of(int2 sub_tile, int lane) { return {sub_tile.x + (lane & 7), sub_tile.y + (lane >> 3)}; }

/// Returns whether a splat reaches the rectangle of pixel centres of the sub-tile whose first pixel is `corner`.
__device__ inline bool reaches(const Splat<float>& s, int2 corner) {
    return min_power_in_rectangle(s, float(corner.x), float(corner.y), float(kSubX - 1), float(kSubY - 1)) <=
           touch_threshold(s);
}

/// Returns which of a tile's sub-tiles a splat reaches, as bits, or which of their parts: rectangles of `size` pixels
/// that begin at `offset` of each sub-tile.
__device__ inline unsigned reached_sub_tiles(const Splat<float>& s, int2 tile_corner, int2 offset, int2 size) {
    const EllipseRows rows(s);
    const float x = tile_corner.x + offset.x + 0.5f - s.mean.x, y = tile_corner.y + offset.y + 0.5f;
    unsigned reached = 0;
#pragma unroll
    for (int row = 0; row < kSubTiles / 2; ++row) {
        const float low = y + row * kSubY;
        const EllipseRows::Reach reach = rows.between(low, low + (size.y - 1));
#pragma unroll
        for (int column = 0; column < 2; ++column)
            if (reach.right >= x + column * kSubX && reach.left <= x + (column * kSubX + size.x - 1))
                reached |= 1u << (row * 2 + column);
    }
    return reached;
}

/// Returns the place of the lists of a tile's first 32 instances. Those of the next instances follow.
__device__ inline std::size_t first_group(int tile, std::uint32_t tile_begin) { return tile_begin / 32 + tile; }

/// Returns the place of the first state that is saved within a tile's list.
__device__ inline std::uint32_t first_checkpoint(std::uint32_t tile_begin) { return tile_begin / kChunk; }

/// The splats of one warp in shared memory. All lanes read the same splat, 16 bytes at a time.
struct SplatBatch {
    float4 a[32];  ///< mean x, mean y, qa, qb
    float4 b[32];  ///< qc, opacity, red, green
    float blue[32];

    struct Entry {
        FragmentShape<float> shape;
        float r, g, b;
    };
    __device__ void store(int k, const Splat<float>& s) {
        const FragmentShape<float> f = FragmentShape<float>::from(s);
        a[k] = make_float4(f.mx, f.my, f.qa, f.qb);
        b[k] = make_float4(f.qc, f.opacity, s.color.x, s.color.y);
        blue[k] = s.color.z;
    }
    __device__ Entry load(int k) const {
        const float4 u = a[k], v = b[k];
        return {{u.x, u.y, u.z, u.w, v.x, v.y}, v.z, v.w, blue[k]};
    }
};

}  // namespace gs
