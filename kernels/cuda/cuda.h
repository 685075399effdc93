// SPDX-License-Identifier: Apache-2.0
// Checked CUDA calls. Included by .cu files only.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <string>

#include "kernels/core/error.h"

namespace gs {

inline void cuda_check(cudaError_t error, const char* what) {
    if (error == cudaSuccess) return;
    cudaGetLastError(); // clear it: the process may go on, e.g. to write a checkpoint
    throw DeviceError(std::string(what) + ": " + cudaGetErrorString(error));
}
#define GS_CUDA(call) ::gs::cuda_check((call), #call)
/// After every launch, in every build.
#define GS_CUDA_LAUNCHED(name) ::gs::cuda_check(cudaGetLastError(), name)

/// Sum over the warp, in every lane.
template <class T> __device__ T warp_sum(T x) {
#pragma unroll
    for (int step = 16; step; step /= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}

inline unsigned num_blocks(std::int64_t n, int block) { return static_cast<unsigned>((n + block - 1) / block); }

}  // namespace gs
