// SPDX-License-Identifier: Apache-2.0
// Adds up the gradients of cameras in two passes.
#include "kernels/splat/camera_sums_cuda.h"

namespace gs {
namespace {

constexpr int kValues = CameraGradient<float>::kSize, kRowsAtOnce = 25, kThreads = kRowsAtOnce * kValues;
constexpr int kParts = 64;  ///< sums of the first pass for each view

/// Adds up a part of the rows of a view in each block: blockIdx.x is the part, blockIdx.y the view.
__global__ void __launch_bounds__(kThreads)
    sum_part(const float* __restrict__ rows, std::int64_t num_rows, float* __restrict__ partial) {
    __shared__ float sums[kThreads];
    const std::int64_t of_part = (num_rows + kParts - 1) / kParts, first = blockIdx.x * of_part,
                       end = min(first + of_part, num_rows);
    rows += blockIdx.y * num_rows * kValues;
    float sum = 0;
#pragma unroll 4
    for (std::int64_t k = first * kValues + threadIdx.x; k < end * kValues; k += kThreads) sum += rows[k];
    sums[threadIdx.x] = sum;
    __syncthreads();
    if (threadIdx.x >= kValues) return;
    for (int k = threadIdx.x + kValues; k < kThreads; k += kValues) sum += sums[k];
    partial[(blockIdx.y * kParts + blockIdx.x) * kValues + threadIdx.x] = sum;
}

/// Adds up the parts of the view blockIdx.x.
__global__ void sum_parts(const float* __restrict__ partial, float* __restrict__ out) {
    if (threadIdx.x >= kValues) return;
    double sum = 0;
    for (int part = 0; part < kParts; ++part) sum += partial[(blockIdx.x * kParts + part) * kValues + threadIdx.x];
    out[blockIdx.x * kValues + threadIdx.x] = float(sum);
}

}  // namespace

void CudaCameraSums::reserve(std::int64_t n, int num_views) {
    rows_.reserve(std::size_t(num_views) * std::size_t(num_camera_rows(n)) * kValues);
    partial_.reserve(std::size_t(num_views) * kParts * kValues);
}

void CudaCameraSums::add_up(std::int64_t n, int num_views, float* out, cudaStream_t stream) {
    sum_part<<<dim3(kParts, unsigned(num_views)), kThreads, 0, stream>>>(rows_.get(), num_camera_rows(n),
                                                                         partial_.get());
    GS_CUDA_LAUNCHED("sum_part");
    sum_parts<<<unsigned(num_views), 32, 0, stream>>>(partial_.get(), out);
    GS_CUDA_LAUNCHED("sum_parts");
}

}  // namespace gs
