// SPDX-License-Identifier: Apache-2.0
// The sum of many rows, for a step on several views.
#include "kernels/optimizer/sum_rows_cuda.h"

namespace gs {
namespace {

__global__ void __launch_bounds__(kSumThreads* kSumColumns)
    sum_columns(SparseRows in, int rows, int width, float* __restrict__ out) {
    const int column = blockIdx.x * kSumColumns + threadIdx.x;
    const float sum = sum_of_set_rows(in, rows, width, column);
    if (threadIdx.y == 0 && column < width) out[column] = sum;
}

}  // namespace

void sum_rows(const SparseRows& in, int rows, int width, float* out, cudaStream_t stream) {
    if (width == 0) return;
    sum_columns<<<num_blocks(width, kSumColumns), dim3(kSumColumns, kSumThreads), 0, stream>>>(in, rows, width, out);
    GS_CUDA_LAUNCHED("sum_columns");
}

}  // namespace gs
