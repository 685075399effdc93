// SPDX-License-Identifier: Apache-2.0
// The loss (1-lambda) L1 + lambda (1-SSIM) and its gradient (docs/math/optimization.md#loss).
#pragma once

#include <vector>

#include "kernels/requests.h"

namespace gs {

/// Computes the loss of images. Buffers are reused from call to call.
template <class Real> class ImageLoss {
  public:
    /// Compares the render `image`, planar (3,H,W), with a target of the same size, which is composited on `background`
    /// if it has alpha. Overwrites dL_dimage (3,H,W). With a mask, L1 is the weighted mean; SSIM is computed on both
    /// images multiplied by the mask, and averaged with the mask as weight. An all-zero mask gives loss 0 and gradient
    /// 0. The result does not depend on the number of threads, to the bit. Takes about 60 bytes per pixel and channel.
    ViewLoss compute(const Real* image, const TargetImage& target, const Vec3<float>& background,
                     const LossWeights& weights, Real* dL_dimage);

    /// Returns half the squared error, weighted by the mask and summed over pixels and channels, and writes its
    /// gradient to `out` (3,H,W). It is not a term of the loss: scores of residuals use it.
    double half_squared_error(const Real* image, const TargetImage& target, const Vec3<float>& background, Real* out);
    /// Writes the weight of each pixel to `out` (3,H,W): its mask value, or 1 without a mask.
    void mask_weights(const TargetImage& target, Real* out) const;

  private:
    /// Multiplies the target and a copy of the image by the mask. Returns the sum of the weights.
    double apply_mask(const Real* image, const std::uint8_t* mask, std::size_t pixels);

    std::vector<Real> target_, weight_, masked_, maps_;
    std::vector<double> l1_sums_, ssim_sums_;  ///< (tasks) sums, added up in order
};

extern template class ImageLoss<float>;
extern template class ImageLoss<double>;

}  // namespace gs
