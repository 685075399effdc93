// SPDX-License-Identifier: Apache-2.0
// The lag of residuals in the form that kernels take.
#pragma once

#include "kernels/optimizer/lazy_adam.h"
#include "kernels/optimizer/moments_cuda.cuh"

namespace gs {

/// The steps by which residuals are behind (lazy_adam.h).
struct LazyArgs {
    std::uint32_t* last_step;  ///< (n) Adam's step up to which a residual is caught up; null if none is behind
    std::uint32_t step;        ///< step to be taken
    MomentRows moments;        ///< moments of the residuals
    LazyTable table;

    __device__ int lag(std::int64_t i) const { return last_step ? int(step - 1 - last_step[i]) : 0; }
};

}  // namespace gs
