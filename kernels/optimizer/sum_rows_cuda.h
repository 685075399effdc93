// SPDX-License-Identifier: Apache-2.0
// The sum of many rows, on the device. Only .cu files include this header.
#pragma once

#include <cstdint>

#include "kernels/cuda/cuda.h"

namespace gs {

/// Rows of values, some of which may be unwritten.
struct SparseRows {
    float* values;         ///< (rows, width)
    std::uint8_t* is_set;  ///< (rows) 1: the row is written; 0: it counts as zero
};

/// Dimensions (kSumColumns, kSumThreads) of a block that adds up columns: eight values are 32 bytes of a row, the
/// smallest unit of a read.
inline constexpr int kSumThreads = 64, kSumColumns = 8;

/// Returns the sum of a column in the threads with threadIdx.y 0. Adds in a fixed order. All threads of the block must
/// call it; columns from `width` on have no values.
__device__ inline float sum_of_set_rows(const SparseRows& in, int rows, int width, int column) {
    constexpr int kRowsAtOnce = 4096;
    __shared__ std::uint8_t is_set[kRowsAtOnce];
    __shared__ float partial[kSumThreads][kSumColumns];
    float sum = 0;
    for (int first = 0; first < rows; first += kRowsAtOnce) {
        const int num = min(rows - first, kRowsAtOnce);
        __syncthreads();
        for (int row = threadIdx.y * kSumColumns + threadIdx.x; row < num; row += kSumThreads * kSumColumns)
            is_set[row] = in.is_set[first + row];
        __syncthreads();
        if (column >= width) continue;
#pragma unroll 8
        for (int row = threadIdx.y; row < num; row += kSumThreads)
            if (is_set[row]) sum += in.values[std::int64_t(first + row) * width + column];
    }
    partial[threadIdx.y][threadIdx.x] = sum;
    for (int half = kSumThreads / 2; half > 0; half /= 2) {
        __syncthreads();
        if (threadIdx.y < half) partial[threadIdx.y][threadIdx.x] += partial[threadIdx.y + half][threadIdx.x];
    }
    return partial[threadIdx.y][threadIdx.x];
}

/// Writes the sum of `rows` rows to `out` (width). Adds in a fixed order.
void sum_rows(const SparseRows& in, int rows, int width, float* out, cudaStream_t stream);

}  // namespace gs
