// SPDX-License-Identifier: Apache-2.0
// The loss of loss.h on the device. Only .cu files include this header.
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// A rendered image and its target, both on the device.
struct CudaLossInput {
    const float* image = nullptr;  ///< (3,H,W)
    TargetImage target;            ///< target with device pointers
    Vec3<float> background{0, 0, 0};
    LossWeights weights = {};
    double weight_sum = 0;  ///< sum of the mask's weights, or the number of pixels without a mask
};

/// Writes the gradient of half the squared error, weighted by the mask and summed over pixels and channels, to `out`
/// (3,H,W), and adds that sum to *error. It is not a term of the loss: scores of residuals use it.
void write_half_squared_error(const CudaLossInput& in, float* out, double* error, cudaStream_t stream);
/// Writes the weight of each pixel to `out` (3,H,W): its mask value, or 1 without a mask. The target must have its
/// pixels.
void write_mask_weights(const TargetImage& target, float* out, cudaStream_t stream);

/// The sums of weighted |difference| and of weighted SSIM over each block, not yet divided by 3 weight_sum.
struct CudaLossSums {
    const float2* of_blocks = nullptr;
    unsigned count = 0;
};

class CudaLoss {
  public:
    /// Takes the buffers of compute() for a view of this size.
    void take(Carver& c, int width, int height);
    /// Writes dL_dimage (3,H,W) and sums(). Sets control->loss_not_finite if a sum is not finite. All sums have a fixed
    /// order.
    void compute(const CudaLossInput& in, float* dL_dimage, StepControl* control, cudaStream_t stream);
    /// Returns the sums of the last compute(); empty if the mask hid all pixels.
    const CudaLossSums& sums() const { return sums_; }

  private:
    float* maps_ = nullptr;       ///< (3 maps, 3, H, W)
    float2* partials_ = nullptr;  ///< (blocks)
    CudaLossSums sums_;
};

// The sums of the loss over the image. The kernel that reports a step adds them up: the blocks of the loss would have
// to wait to find out which of them ends last.

/// Threads of a block that adds up sums.
inline constexpr int kLossSumThreads = 256;

/// Returns the sums of all blocks, in a fixed order: |difference| in x, SSIM in y. All kLossSumThreads threads of a
/// block must call it, once; the first thread gets the result.
__device__ inline double2 add_up(const CudaLossSums& sums) {
    constexpr int kWarps = kLossSumThreads / 32;
    __shared__ double2 parts[kWarps];
    double l1 = 0, ssim = 0;
#pragma unroll 8  // loads that are on their way at once
    for (unsigned k = threadIdx.x; k < sums.count; k += kLossSumThreads) {
        const float2 part = sums.of_blocks[k];
        l1 += part.x, ssim += part.y;
    }
    l1 = warp_sum(l1), ssim = warp_sum(ssim);
    if (threadIdx.x % 32 == 0) parts[threadIdx.x / 32] = make_double2(l1, ssim);
    __syncthreads();
    double2 all = make_double2(0, 0);
    for (const double2& part : parts) all.x += part.x, all.y += part.y;
    return all;
}

}  // namespace gs
