// SPDX-License-Identifier: Apache-2.0
// (1-lambda) L1 + lambda (1-SSIM) and its gradient (docs/math/optimization.md#loss).
#pragma once

#include <vector>

#include "kernels/requests.h"

namespace gs {

struct LossValues {
    double loss = 0, l1 = 0, ssim = 0; ///< loss without regularisers
};

/// Buffers are reused from call to call.
template <class Real> class ImageLoss {
  public:
    /// Render `image`: planar (3,H,W); target of the same size, composited on `background` where it has alpha.
    /// dL_dimage (3,H,W) is overwritten. With a mask, L1 is the weighted mean, and SSIM sees both images multiplied
    /// by the mask and is averaged with it. An all-zero mask gives loss 0 and gradient 0.
    /// Determinism: bitwise, independent of threads. Cost: about 60 bytes per pixel and channel.
    LossValues compute(const Real* image, const TargetImage& target, const Vec3<float>& background, double lambda_dssim, Real* dL_dimage);

  private:
    std::vector<Real> target_, weight_, masked_, maps_;
    std::vector<double> l1_sums_, ssim_sums_; ///< by task, added in order
};

extern template class ImageLoss<float>;
extern template class ImageLoss<double>;

}  // namespace gs
