// SPDX-License-Identifier: Apache-2.0
// The loss of loss.h on the device.
#pragma once

#include "kernels/backend.h"
#include "kernels/core/device_memory.h"

namespace gs {

/// A target image on the device: as TargetImage, with device pointers.
struct CudaLossInput {
    const float* image;  ///< (3,H,W)
    TargetImage target;
    Vec3<float> background;
    float lambda_dssim;
    double weight_sum;   ///< sum of the mask's weights, or the number of pixels
};

/// Buffers are reused from call to call.
class CudaLoss {
  public:
    /// Writes dL_dimage (3,H,W) and adds to totals: [0] sum of weighted |difference|, [1] sum of weighted SSIM, both not
    /// yet divided by 3 weight_sum. totals must be zeroed. Float atomics once a block.
    void compute(const CudaLossInput& in, float* dL_dimage, double* totals, cudaStream_t stream);

  private:
    DeviceBuffer<float> maps_; ///< (3 maps, 3, H, W)
};

}  // namespace gs
