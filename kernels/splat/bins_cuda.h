// SPDX-License-Identifier: Apache-2.0
// The order of instances on the device, which sorting hands to blending.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"

namespace gs {

/// A part of the work on tiles: a tile, or of one with a long list a quarter of each of its sub-tiles.
struct TileItem {
    std::uint32_t word = kNone;

    static constexpr std::uint32_t kNone = 0xffffffff;

    __device__ static TileItem whole(std::uint32_t tile) { return {tile << 3}; }
    __device__ static TileItem part(std::uint32_t tile, int quarter) { return {tile << 3 | 4 | quarter}; }
    __device__ bool is_none() const { return word == kNone; }
    __device__ bool is_whole() const { return !(word & 4); }
    __device__ int tile() const { return int(word >> 3); }
    __device__ int quarter() const { return int(word & 3); }
    __device__ bool is_first_of_tile() const { return !is_none() && quarter() == 0; }
};
/// A tile with more than this part of a view's instances is worked on in quarters, which also is the most of such
/// tiles. Quarters are more work together, but end sooner: with 320, 450, 640 and 1280 the forward pass took 0.163,
/// 0.155, 0.168 and 0.202 ms on lego (0.175 without) and 0.284, 0.275, 0.280 and 0.307 ms on bonsai (0.329).
inline constexpr int kMostQuartered = 450;

/// The instances of a view in the order of blending. All pointers are on the device.
struct CudaBins {
    int tiles_x = 0, tiles_y = 0;
    /// The Gaussians by tile and depth; slots instead where `gaussians` is set.
    const std::uint32_t* instances = nullptr;
    const std::uint32_t* gaussians = nullptr;     ///< Gaussian of each slot; only where the order of sums is fixed
    const std::uint32_t* tile_offsets = nullptr;  ///< (tiles+1)
    /// (num_items()): those that take longest first (about in order), so that no long list is left for last; then none.
    const TileItem* longest_first = nullptr;

    __host__ __device__ int num_tiles() const { return tiles_x * tiles_y; }
    int num_items() const { return num_tiles() + 3 * (num_tiles() < kMostQuartered ? num_tiles() : kMostQuartered); }
};

/// The slots of each Gaussian, which are consecutive: those of the k-th Gaussian in depth order end at slot_ends[k].
struct SlotMap {
    const std::uint32_t *order, *slot_ends;
};

}  // namespace gs
