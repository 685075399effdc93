// SPDX-License-Identifier: Apache-2.0
// The order of instances on the device, which sorting hands to blending.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"

namespace gs {

/// The instances of a view in the order of blending. All pointers are on the device.
struct CudaBins {
    int tiles_x = 0, tiles_y = 0;
    /// The Gaussians by tile and depth; slots instead where `gaussians` is set.
    const std::uint32_t* instances = nullptr;
    const std::uint32_t* gaussians = nullptr;     ///< Gaussian of each slot; only where the order of sums is fixed
    const std::uint32_t* tile_offsets = nullptr;  ///< (tiles+1)
    /// The tiles, those with the longest lists first (about in order), so that no long list is left for last.
    const std::uint32_t* longest_first = nullptr;

    __host__ __device__ int num_tiles() const { return tiles_x * tiles_y; }
};

/// The slots of each Gaussian, which are consecutive: those of the k-th Gaussian in depth order end at slot_ends[k].
struct SlotMap {
    const std::uint32_t *order, *slot_ends;
};

}  // namespace gs
