// SPDX-License-Identifier: Apache-2.0
// How threads, pixels and a batch of splats are laid out in the blend kernels. Included by blend*.cu only.
#pragma once

#include "kernels/blend/blend_cuda.h"

namespace gs {

__device__ inline int2 tile_corner(int tile, int tiles_x) { return {tile % tiles_x * kCudaTileX, tile / tiles_x * kCudaTileY}; }
/// Sub-tiles of a tile: two in a row, three rows. Threads of a block are numbered sub-tile by sub-tile.
__device__ inline int2 sub_tile_corner(int2 corner, int warp) { return {corner.x + (warp & 1) * kSubX, corner.y + (warp >> 1) * kSubY}; }
__device__ inline int2 pixel_of(int2 corner, int warp, int lane) {
    const int2 s = sub_tile_corner(corner, warp);
    return {s.x + (lane & 7), s.y + (lane >> 3)};
}

/// Splats of a chunk in shared memory. All lanes read the same one, 16 bytes at a time.
struct SplatBatch {
    float4 a[kChunk]; ///< mean x, mean y, qa, qb
    float4 b[kChunk]; ///< qc, opacity, red, green
    float blue[kChunk];

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
