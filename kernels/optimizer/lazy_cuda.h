// SPDX-License-Identifier: Apache-2.0
// Which residuals are behind by how many steps, on the device (lazy_adam.h).
#pragma once

#include <algorithm>

#include "kernels/cuda/model_cuda.h"
#include "kernels/optimizer/lazy_args_cuda.cuh"

namespace gs {

/// The residuals of `model` under lazy updates. Every call works on `stream`.
class CudaLazyResiduals {
  public:
    CudaLazyResiduals(CudaModel& model, cudaStream_t stream) : model_(model), stream_(stream) {}

    /// All rows are up to date after Adam's step `step`: a new model, or new or moved rows.
    void reset(std::int64_t step);
    /// Whether catch_up() must come before this step.
    bool due(std::int64_t step) const { return step - caught_up_ > kMaxLag; }
    /// What the next step needs to know. Columns with rates of their own are not updated lazily: all rows are, in each step.
    LazyArgs begin_step(std::int64_t step, bool lazy, double rate);
    /// Steps after `step` were begun but never took place.
    void rewind(std::int64_t step) { step_ = step, caught_up_ = std::min(caught_up_, step); }
    /// Takes all missed steps. Those in flight must be done.
    void catch_up();

    std::int64_t bytes() const { return last_step_.bytes(); }

  private:
    CudaModel& model_;
    cudaStream_t stream_;
    DeviceBuffer<std::uint32_t> last_step_;
    LazySchedule schedule_;
    std::int64_t step_ = 0;        ///< the last one begun
    std::int64_t caught_up_ = 0;   ///< all rows are up to date at least to this step
};

}  // namespace gs
