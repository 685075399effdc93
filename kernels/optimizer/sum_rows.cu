// SPDX-License-Identifier: Apache-2.0
// A block adds up eight columns: 32 bytes of a row, the least that a read moves.
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs {
namespace {

constexpr int kSumThreads = 64, kSumColumns = 8;

__global__ void __launch_bounds__(kSumThreads* kSumColumns)
    sum_columns(const float* __restrict__ in, std::int64_t rows, int width, float* __restrict__ out) {
    __shared__ float partial[kSumThreads][kSumColumns];
    const int column = blockIdx.x * kSumColumns + threadIdx.x;
    float sum = 0;
    if (column < width)
        for (std::int64_t row = threadIdx.y; row < rows; row += kSumThreads) sum += in[row * width + column];
    partial[threadIdx.y][threadIdx.x] = sum;
    for (int half = kSumThreads / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.y < half) partial[threadIdx.y][threadIdx.x] += partial[threadIdx.y + half][threadIdx.x];
    }
    if (threadIdx.y == 0 && column < width) out[column] = partial[0][threadIdx.x];
}

}  // namespace

void sum_rows(const float* in, std::int64_t rows, int width, float* out, cudaStream_t stream) {
    if (width == 0) return;
    sum_columns<<<num_blocks(width, kSumColumns), dim3(kSumColumns, kSumThreads), 0, stream>>>(in, rows, width, out);
    GS_CUDA_LAUNCHED("sum_columns");
}

}  // namespace gs
