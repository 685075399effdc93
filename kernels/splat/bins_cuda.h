// SPDX-License-Identifier: Apache-2.0
// The order of instances on the device: what sorting hands to blending.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"

namespace gs {

/// What blending needs to know about the order of instances. All pointers are on the device.
struct CudaBins {
    int tiles_x = 0, tiles_y = 0;
    const std::uint32_t* instances = nullptr;    ///< by tile and depth: Gaussian, or slot where `gaussians` is set
    const std::uint32_t* gaussians = nullptr;    ///< by slot; only where the order of sums is fixed
    const std::uint32_t* tile_offsets = nullptr; ///< (tiles+1)
    const std::uint32_t* longest_first = nullptr; ///< (tiles): about in the order of their lists' lengths, so that none is left for last

    __host__ __device__ int num_tiles() const { return tiles_x * tiles_y; }
};

/// Slots of one Gaussian are consecutive: those of the k-th in depth order end at slot_ends[k].
struct SlotMap {
    const std::uint32_t *order, *slot_ends;
};

}  // namespace gs
