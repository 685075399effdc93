// SPDX-License-Identifier: Apache-2.0
// The loss of loss.h on the device.
#pragma once

#include "kernels/cuda/device_memory.h"
#include "kernels/requests.h"
#include "kernels/splat/step_control_cuda.h"

namespace gs {

/// A rendered image and its target, both on the device: `target` as TargetImage, with device pointers.
struct CudaLossInput {
    const float* image;  ///< (3,H,W)
    TargetImage target;
    Vec3<float> background;
    float lambda_dssim;
    double weight_sum;   ///< sum of the mask's weights, or the number of pixels
};

class CudaLoss {
  public:
    /// Takes what compute() needs for a view of this size.
    void take(Carver& c, int width, int height);
    /// Writes dL_dimage (3,H,W), and to control->l1 and ->ssim the sums of weighted |difference| and weighted SSIM, not yet
    /// divided by 3 weight_sum. All sums have a fixed order.
    void compute(const CudaLossInput& in, float* dL_dimage, StepControl* control, cudaStream_t stream);

  private:
    bool has_taps_ = false;     ///< the filter is on the device
    float* maps_ = nullptr;     ///< (3 maps, 3, H, W)
    float2* partials_ = nullptr; ///< by block: sums of |difference| and of SSIM
};

}  // namespace gs
