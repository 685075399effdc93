// SPDX-License-Identifier: Apache-2.0
// Blending on the device: forward per pixel, backward per Gaussian (rasterizer spec sections 7 and 8).
#pragma once

#include "kernels/blend/blend_device.h"
#include "kernels/sort/binning_cuda.h"

namespace gs {

/// Sums of one Gaussian over all pixels, as three 16-byte groups so that the device adds them with three atomics.
struct alignas(16) PackedSums {
    float4 a; ///< h, hx, hy, hxx
    float4 b; ///< hxy, hyy, r, g
    float4 c; ///< b, unused
};

/// Buffers are reused from call to call.
class CudaBlend {
  public:
    /// image (3,H,W), transmittance (H,W). With `for_backward` it keeps checkpoints for backward().
    void forward(const CudaBins& bins, const Splat<float>* splats, const SplatBounds* bounds, int width, int height, Vec3<float> background, float* image,
                 float* transmittance, bool for_backward, cudaStream_t stream);
    /// Adds to sums (n), which the caller zeroed. Float atomics: the order of additions varies from run to run.
    void backward(const CudaBins& bins, const Splat<float>* splats, const SplatBounds* bounds, int width, int height, Vec3<float> background,
                  const float* image, const float* transmittance, const float* dL_dimage, PackedSums* sums, cudaStream_t stream);

  private:
    DeviceBuffer<float4> checkpoints_;            ///< (buckets, 192): colour so far and transmittance
    DeviceBuffer<std::uint32_t> bucket_tiles_;    ///< (buckets)
    DeviceBuffer<std::uint32_t> last_, max_last_; ///< (tiles*192), (tiles): instances of the tile up to the last contributor
};

}  // namespace gs
