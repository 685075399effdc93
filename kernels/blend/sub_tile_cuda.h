// SPDX-License-Identifier: Apache-2.0
// The layout of threads, pixels and batches of splats in the blend kernels. Only the .cu files of this folder include
// this header.
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

/// Returns the sub-tiles of a tile that a splat reaches, as bits. With a smaller `size`, tests a part of each sub-tile:
/// the rectangle of `size` pixels that begins at `offset`.
__device__ inline unsigned reached_sub_tiles(const Splat<float>& s, int2 tile_corner, int2 offset, int2 size) {
    const EllipseRows rows(s);
    const float x = tile_corner.x + offset.x + 0.5f - s.mean.x, y = tile_corner.y + offset.y + 0.5f;
    unsigned reached = 0;
#pragma unroll
    for (int row = 0; row < kSubTiles / 2; ++row) {
        const EllipseRows::Reach reach = rows.between(y + row * kSubY, y + row * kSubY + (size.y - 1));
#pragma unroll
        for (int column = 0; column < 2; ++column)
            if (reach.meets(x + column * kSubX, x + (column * kSubX + size.x - 1))) reached |= 1u << (row * 2 + column);
    }
    return reached;
}

/// Returns whether a splat reaches the sub-tile whose first pixel is `corner`.
__device__ inline bool reaches(const Splat<float>& s, int2 corner) {
    const float x = corner.x + 0.5f - s.mean.x, y = corner.y + 0.5f;
    return EllipseRows(s).between(y, y + (kSubY - 1)).meets(x, x + (kSubX - 1));
}

/// Returns the index of the lists of a tile's first 32 instances. The lists of the next instances follow.
__device__ inline std::size_t first_group(int tile, std::uint32_t tile_begin) { return tile_begin / 32 + tile; }

/// Returns the index of the state saved before a tile's instance `first`, which begins a chunk but not the tile.
__device__ inline std::size_t checkpoint_before(std::uint32_t tile_begin, std::uint32_t first) {
    return tile_begin / kChunk + first / kChunk - 1;
}

}  // namespace gs
