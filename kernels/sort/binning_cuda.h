// SPDX-License-Identifier: Apache-2.0
// Sorts Gaussians by depth, then their instances stably by tile, on the device (docs/math/rasterizer.md#sorting).
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/splat/bins_cuda.h"
#include "kernels/splat/depth_key.h"
#include "kernels/splat/splat_cuda.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// The arrays that preprocessing fills and binning sorts, (n) each.
struct CudaBinningInput {
    std::uint32_t* depth_keys;  ///< kDepthKeyBits bits; culled Gaussians sort last
    TileSpan* spans;
    std::uint32_t* counts;  ///< number of touched tiles; 0 = culled
};

/// The sort on the device.
class CudaBinning {
  public:
    /// Takes the buffers that outlive binning.
    void take_results(Carver& c, std::int64_t n, std::int64_t capacity, int width, int height, bool keep_slots);
    /// Takes the buffers that only binning uses, and the rest of `input`.
    void take_temporaries(Carver& c);

    const CudaBinningInput& input() const { return input_; }
    /// Sorts at most `room` instances, which is at most the capacity: so many are sorted, whether they exist or not. If
    /// there are more, it writes none and sets control->stopped.
    CudaBins build(const PackedSplat* splats, std::int64_t room, StepControl* control, cudaStream_t stream);
    /// Returns the order of the last build().
    const CudaBins& bins() const { return bins_; }
    SlotMap slots() const { return {order_, ends_}; }
    std::int64_t bytes() const { return identity_.bytes(); }

  private:
    template <class Key>
    void sort_instances(const PackedSplat* splats, std::int64_t room, StepControl* control, cudaStream_t stream);
    int tile_bits() const;

    std::int64_t n_ = 0, capacity_ = 0;
    CudaBins bins_;
    bool keep_slots_ = false;
    CudaBinningInput input_{};
    DeviceBuffer<std::uint32_t> identity_;  ///< 0, 1, 2, ...: the values to sort
    uint2* large_ = nullptr;  ///< large Gaussians and their first instances; before that, sorted depth keys
    // Tile keys hold 16-bit values where these suffice.
    std::uint32_t *order_ = nullptr, *ends_ = nullptr, *unsorted_ = nullptr, *gaussians_ = nullptr, *sorted_ = nullptr,
                  *tile_offsets_ = nullptr, *tile_keys_ = nullptr, *sorted_tile_keys_ = nullptr;
    TileItem* longest_first_ = nullptr;
    unsigned char* workspace_ = nullptr;
    std::size_t workspace_bytes_ = 0;
};

}  // namespace gs
