// SPDX-License-Identifier: Apache-2.0
// The gradients of cameras on the device: sums over Gaussians, in a fixed order. Only .cu files include this header.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"
#include "kernels/cuda/device_memory.h"
#include "kernels/splat/gaussian_rows_device.h"

namespace gs {

/// Returns the number of sums for `n` Gaussians: one for each warp.
GS_HD std::int64_t num_camera_rows(std::int64_t n) { return (n + 31) / 32; }

/// Adds up a warp's parts of the gradient of a camera, times `factor`, and writes the sum to `row` (kSize). All lanes
/// must call it.
__device__ inline void store_camera_sum(const GaussianGradient<float>& gradient, float factor,
                                        float* __restrict__ row) {
    const int lane = threadIdx.x & 31;
    float mine = 0;
    CameraGradient<float> part = gradient.of_camera();
    part.for_each([&](int k, float number) {
        for (int half = 16; half > 0; half /= 2) number += __shfl_xor_sync(~0u, number, half);
        if (lane == k) mine = number;
    });
    if (lane < CameraGradient<float>::kSize) row[lane] = mine * factor;
}

/// The sums of a step's cameras.
class CudaCameraSums {
  public:
    /// Makes room for steps on `num_views` views of `n` Gaussians. Must be called before the step is enqueued.
    void reserve(std::int64_t n, int num_views);
    /// Returns the place of the sums of warps, (views, num_camera_rows(n), kSize).
    float* rows() const { return rows_.get(); }
    /// Enqueues the sums over all warps, which are written to `out` (views, kSize).
    void add_up(std::int64_t n, int num_views, float* out, cudaStream_t stream);
    std::int64_t bytes() const { return rows_.bytes() + partial_.bytes(); }

  private:
    DeviceBuffer<float> rows_, partial_;
};

}  // namespace gs
