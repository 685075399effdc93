// SPDX-License-Identifier: Apache-2.0
// Depth sort of Gaussians, then stable tile sort of their instances, on the device (rasterizer spec section 6).
#pragma once

#include "kernels/core/device_memory.h"
#include "kernels/preprocess/preprocess_device.h"

namespace gs {

/// Tiles of the CUDA blend: 16x12 pixels, six warps of 8x4 pixels each.
inline constexpr int kCudaTileX = 16, kCudaTileY = 12, kCudaTilePixels = kCudaTileX * kCudaTileY;
/// Gaussians between two checkpoints of the blend state.
inline constexpr int kBucket = 32;

/// Pixel rectangle of a splat, half-open; empty for a culled Gaussian.
struct SplatBounds {
    std::uint16_t x_min, x_max, y_min, y_max;
};

struct CudaBins {
    std::int64_t num_instances = 0;
    int tiles_x = 0, tiles_y = 0;
    const std::uint32_t* instances = nullptr;      ///< Gaussian index, by tile and depth
    const std::uint32_t* tile_offsets = nullptr;   ///< (tiles+1)
    const std::uint32_t* bucket_offsets = nullptr; ///< (tiles+1)
    std::int64_t max_buckets = 0;                  ///< upper bound, known without asking the device
};

/// Buffers are reused from call to call.
class CudaBinning {
  public:
    ~CudaBinning();
    /// splats, bounds: (n) of preprocessing; depth_keys (n): bits of the depth, 0xffffffff where culled. One 8-byte
    /// read-back. Empties the bounds of Gaussians that touch no tile. Throws DeviceError beyond 2^31-1 instances.
    CudaBins build(std::int64_t n, const Splat<float>* splats, SplatBounds* bounds, const std::uint32_t* depth_keys, int width, int height,
                   cudaStream_t stream);

  private:
    DeviceBuffer<std::uint32_t> indices_, sorted_keys_, sorted_indices_, counts_, tile_keys_, sorted_tiles_, instances_, sorted_instances_, tile_offsets_,
        bucket_counts_, bucket_offsets_;
    DeviceBuffer<std::uint64_t> offsets_;
    DeviceBuffer<unsigned char> workspace_;
    std::uint64_t* total_ = nullptr; ///< pinned
};

}  // namespace gs
