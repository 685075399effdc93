// SPDX-License-Identifier: Apache-2.0
// Checked CUDA calls. Only .cu files include this header.
#pragma once

#include <cuda_runtime.h>

#include <cstdint>
#include <string>

#include "kernels/base/error.h"

namespace gs {

/// Throws DeviceError, with `what` and CUDA's message, unless `error` is cudaSuccess.
inline void cuda_check(cudaError_t error, const char* what) {
    if (error == cudaSuccess) return;
    cudaGetLastError();  // clears the error: the process may continue, e.g. to write a checkpoint
    throw DeviceError(std::string(what) + ": " + cudaGetErrorString(error));
}
#define GS_CUDA(call) ::gs::cuda_check((call), #call)
/// Checks a kernel launch. Required after every launch, in every build.
#define GS_CUDA_LAUNCHED(name) ::gs::cuda_check(cudaGetLastError(), name)

/// Returns the sum over the warp, in every lane.
template <class T> __device__ T warp_sum(T x) {
#pragma unroll
    for (int step = 16; step; step /= 2) x += __shfl_xor_sync(~0u, x, step);
    return x;
}

inline unsigned num_blocks(std::int64_t n, int block) { return static_cast<unsigned>((n + block - 1) / block); }

}  // namespace gs
