// SPDX-License-Identifier: Apache-2.0
// Depth sort of Gaussians, then stable tile sort of their instances, on the device (rasterizer spec section 6).
#pragma once

#include "kernels/core/device_memory.h"
#include "kernels/preprocess/splat_cuda.h"

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

/// Where preprocessing leaves what binning sorts. (n) each.
struct CudaBinningInput {
    std::uint32_t* depth_keys; ///< kDepthKeyBits bits; culled Gaussians sort last
    TileSpan* spans;
    std::uint32_t* counts;     ///< tiles touched; 0 = culled
};

/// Slots of one Gaussian are consecutive: those of the k-th in depth order end at slot_ends[k].
struct SlotMap {
    const std::uint32_t *order, *slot_ends;
};

class CudaBinning {
  public:
    /// Takes what outlives binning.
    void take_results(Carver& c, std::int64_t n, std::int64_t capacity, int width, int height, bool keep_slots);
    /// Takes what only binning uses, and `input`.
    void take_temporaries(Carver& c);

    const CudaBinningInput& input() const { return input_; }
    /// Sorts at most `capacity` instances. Beyond it nothing is written, and control->stopped is set.
    CudaBins build(const PackedSplat* splats, StepControl* control, cudaStream_t stream);
    SlotMap slots() const { return {order_, offsets_}; }
    std::int64_t bytes() const { return identity_.bytes(); }

  private:
    template <class Key> void sort_instances(const PackedSplat* splats, StepControl* control, cudaStream_t stream);
    int tile_bits() const;

    std::int64_t n_ = 0, capacity_ = 0;
    CudaBins bins_;
    bool keep_slots_ = false;
    CudaBinningInput input_{};
    DeviceBuffer<std::uint32_t> identity_; ///< 0, 1, 2, ...: values to sort
    std::uint32_t *sorted_keys_ = nullptr, *order_ = nullptr, *offsets_ = nullptr, *unsorted_ = nullptr, *gaussians_ = nullptr, *sorted_ = nullptr,
                  *tile_offsets_ = nullptr, *longest_first_ = nullptr, *tile_keys_ = nullptr, *sorted_tile_keys_ = nullptr; ///< tile keys hold 16-bit values where these suffice
    unsigned char* workspace_ = nullptr;
    std::size_t workspace_bytes_ = 0;
};

}  // namespace gs
