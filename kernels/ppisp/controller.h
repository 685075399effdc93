// SPDX-License-Identifier: Apache-2.0
// The controller on the CPU, which predicts exposure and colour of a view from its uncorrected image
// (docs/math/ppisp.md#controller).
#pragma once

#include <vector>

#include "kernels/ppisp/controller_device.h"

namespace gs {

/// Evaluates controllers and their gradients. It reuses its buffers from call to call.
template <class Real> class Controller {
  public:
    /// Evaluates the controller on a planar (3,H,W) image. Writes kIspFrameValues to `out`, laid out as a frame's
    /// values; they are 0 for an image without a block (controller_sees). The result does not depend on threads, to the
    /// bit.
    void forward(const Real* weights, const Real* image, int width, int height, Real prior_exposure, Real* out);

    /// Computes the gradients of the last forward, with the same weights and image. Overwrites dL_dweights
    /// (kControllerWeights) with them, and with zeros for an image without a block.
    void backward(const Real* weights, const Real* image, const Real* dL_dout, Real* dL_dweights);

  private:
    int width_ = 0, height_ = 0;
    std::vector<Real> row_sums_;       ///< (rows of blocks, 5 bins, 32)
    std::vector<Real> bins_;           ///< (25, 32) means
    std::vector<Real> inputs_[4];      ///< inputs of layers 3 to 6
    std::vector<Real> row_gradients_;  ///< (rows of blocks, kControllerBlockWeights)
};

extern template class Controller<float>;
extern template class Controller<double>;

}  // namespace gs
