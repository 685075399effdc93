// SPDX-License-Identifier: Apache-2.0
// The sums of the loss over the image. The kernel that reports a step adds them up: the blocks of the loss would have
// to wait to know which of them ends last.
#pragma once

#include "kernels/cuda/cuda.h"
#include "kernels/loss/loss_cuda.h"

namespace gs {

/// Threads of a block that adds up sums.
inline constexpr int kLossSumThreads = 256;

/// Returns the sums of all blocks, in a fixed order: |difference| in x, SSIM in y. All kLossSumThreads threads of a
/// block call it, once, and the first has the result.
__device__ inline double2 add_up(const CudaLossSums& sums) {
    constexpr int kWarps = kLossSumThreads / 32;
    __shared__ double2 parts[kWarps];
    double l1 = 0, ssim = 0;
#pragma unroll 8  // loads that are on their way at once
    for (unsigned k = threadIdx.x; k < sums.count; k += kLossSumThreads) {
        const float2 part = sums.of_blocks[k];
        l1 += part.x, ssim += part.y;
    }
    l1 = warp_sum(l1), ssim = warp_sum(ssim);
    if (threadIdx.x % 32 == 0) parts[threadIdx.x / 32] = make_double2(l1, ssim);
    __syncthreads();
    double2 all = make_double2(0, 0);
    for (const double2& part : parts) all.x += part.x, all.y += part.y;
    return all;
}

}  // namespace gs
