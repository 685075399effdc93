// SPDX-License-Identifier: Apache-2.0
// A block adds up a column.
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs {
namespace {

constexpr int kSumBlock = 256;

__global__ void __launch_bounds__(kSumBlock)
    sum_column(const float* __restrict__ in, std::int64_t rows, int width, float share, float* __restrict__ out) {
    __shared__ float partial[kSumBlock];
    float sum = 0;
    for (std::int64_t row = threadIdx.x; row < rows; row += kSumBlock) sum += in[row * width + blockIdx.x];
    partial[threadIdx.x] = sum;
    for (int half = kSumBlock / 2; half > 0; half /= 2) {
        __syncthreads();
        if (int(threadIdx.x) < half) partial[threadIdx.x] += partial[threadIdx.x + half];
    }
    if (threadIdx.x == 0) out[blockIdx.x] = share * partial[0];
}

}  // namespace

void sum_rows(const float* in, std::int64_t rows, int width, float share, float* out, cudaStream_t stream) {
    if (width == 0) return;
    sum_column<<<width, kSumBlock, 0, stream>>>(in, rows, width, share, out);
    GS_CUDA_LAUNCHED("sum_column");
}

}  // namespace gs
