// SPDX-License-Identifier: Apache-2.0
// The handles of residual_handles.h on the device.
#pragma once

#include "kernels/cuda/model_cuda.h"

namespace gs {

/// Like ResidualHandles. While this lives, `model` seems to be one whose Gaussians all have a residual of one value.
class CudaResidualHandles {
  public:
    /// `always`: for a model whose Gaussians all have a residual, too.
    CudaResidualHandles(CudaModel& model, cudaStream_t stream, bool always = false);
    /// Puts the residuals back as they were, unless they were resolved. If rows have moved by then, which only an error
    /// leads to, the model is broken.
    ~CudaResidualHandles();
    CudaResidualHandles(const CudaResidualHandles&) = delete;
    CudaResidualHandles& operator=(const CudaResidualHandles&) = delete;

    /// Takes the residual from the Gaussians without a mark, as Backend::keep_residuals does. `marks` (n) and `bases`
    /// (n,3), or null, are on the device, but not in the scratch.
    void keep(const unsigned char* marks, const float* bases);
    /// Makes rows of the handles, and waits. It may use all of `scratch`.
    void resolve(Scratch& scratch);

  private:
    /// Exchanges the residuals and their moments with model_.handles.
    void swap_arrays();

    CudaModel& model_;
    cudaStream_t stream_;
    bool active_;
    int width_ = 0;
    std::int64_t num_residuals_ = 0, without_residual_ = 0;
};

}  // namespace gs
