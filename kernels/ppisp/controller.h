// SPDX-License-Identifier: Apache-2.0
// The controller on the CPU: exposure and colour of a view, guessed from its uncorrected image
// (docs/math/ppisp.md#controller).
#pragma once

#include <vector>

#include "kernels/ppisp/controller_device.h"

namespace gs {

/// Buffers are reused from call to call.
template <class Real> class Controller {
  public:
    /// Image planar (3,H,W); `out` gets kIspFrameValues, laid out as a frame's values: zeros for an image without a block
    /// (controller_sees). Determinism: bitwise, independent of threads.
    void forward(const Real* weights, const Real* image, int width, int height, Real prior_exposure, Real* out);

    /// Of the last forward, with the same weights and image. dL_dweights (kControllerWeights) is overwritten: zeros for an image
    /// without a block.
    void backward(const Real* weights, const Real* image, const Real* dL_dout, Real* dL_dweights);

  private:
    int width_ = 0, height_ = 0;
    std::vector<Real> row_sums_;   ///< (rows of blocks, 5 bins, 32)
    std::vector<Real> bins_;       ///< (25, 32) means
    std::vector<Real> inputs_[4];  ///< of layers 3 to 6
    std::vector<Real> row_gradients_; ///< (rows of blocks, kControllerBlockWeights)
};

extern template class Controller<float>;
extern template class Controller<double>;

}  // namespace gs
