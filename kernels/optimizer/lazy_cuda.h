// SPDX-License-Identifier: Apache-2.0
// The lazy updates of residuals on the device (lazy_adam.h). Only .cu files include this header.
#pragma once

#include <algorithm>

#include "kernels/cuda/model_cuda.h"
#include "kernels/optimizer/lazy_adam.h"
#include "kernels/optimizer/moments_cuda.cuh"

namespace gs {

/// Arguments for residuals that have missed steps (lazy_adam.h).
struct LazyArgs {
    std::uint32_t* last_step;  ///< (n) last of Adam's steps applied to a residual; null if all are up to date
    std::uint32_t step;        ///< step to be taken
    MomentRows moments;        ///< moments of the residuals
    LazyTable table;

    __device__ int lag(std::int64_t i) const { return last_step ? int(step - 1 - last_step[i]) : 0; }
};

/// Updates the residuals of `model` lazily. Every call works on `stream`.
class CudaLazyResiduals {
  public:
    CudaLazyResiduals(CudaModel& model, cudaStream_t stream) : model_(model), stream_(stream) {}

    /// Marks all rows as up to date after Adam's step `step`. Required for a new model, and after rows were added or
    /// moved.
    void reset(std::int64_t step);
    /// Returns whether catch_up() must be called before this step.
    bool due(std::int64_t step) const { return step - caught_up_ > kMaxLag; }
    /// Returns the arguments of the next step. Without `lazy` no row falls behind: that is required if columns have
    /// separate rates, or if only visible Gaussians take steps, whose missed steps GaussianState::last_step records.
    /// The array is allocated at the first lazy step.
    LazyArgs begin_step(std::int64_t step, bool lazy, double rate);
    /// Reverts the steps after `step`, which were begun but never took place.
    void rewind(std::int64_t step) { step_ = step, caught_up_ = std::min(caught_up_, step); }
    /// Takes all missed steps. No step may be in flight.
    void catch_up();

    std::int64_t bytes() const { return last_step_.bytes(); }

  private:
    CudaModel& model_;
    cudaStream_t stream_;
    DeviceBuffer<std::uint32_t> last_step_;
    LazySchedule schedule_;
    bool filled_ = false;         ///< whether last_step_ holds a step for each row
    std::int64_t step_ = 0;       ///< last step begun
    std::int64_t caught_up_ = 0;  ///< step to which all rows are at least up to date
};

}  // namespace gs
