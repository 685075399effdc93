// SPDX-License-Identifier: Apache-2.0
// Which residuals are behind, as kernels take it.
#pragma once

#include "kernels/optimizer/lazy_adam.h"
#include "kernels/optimizer/moments_cuda.cuh"

namespace gs {

/// How far the residuals of Gaussians are behind (lazy_adam.h).
struct LazyArgs {
    std::uint32_t* last_step; ///< (n) Adam's step up to which a residual is caught up; null: all are
    std::uint32_t step;       ///< the step to be taken
    MomentRows moments;       ///< of the residuals
    LazyTable table;

    __device__ int lag(std::int64_t i) const { return last_step ? int(step - 1 - last_step[i]) : 0; }
};

}  // namespace gs
