// SPDX-License-Identifier: Apache-2.0
// Copies residual rows between global and shared memory. Rows are long: if each thread read its own row, a warp would
// touch 32 cache lines at every column. The rows of a warp are contiguous, and its lanes copy them together. Each
// thread then finds its row in shared memory.
#pragma once

#include <cuda_pipeline.h>

#include "kernels/optimizer/moments_cuda.cuh"

namespace gs {

/// The elements of a warp's rows that a mask selects, dealt to the lanes in order.
class RowElements {
  public:
    /// Deals the elements of the rows in `mask`. `list` is 32 bytes of this warp's shared memory. All lanes must call
    /// it, converged.
    __device__ RowElements(unsigned mask, int width, std::uint8_t* list) : list_(list), width_(width) {
        const int lane = threadIdx.x & 31;
        rows_ = __popc(mask);
        if (mask >> lane & 1) list[__popc(mask & ((1u << lane) - 1))] = std::uint8_t(lane);
        __syncwarp();
        row_ = lane / width, column_ = lane - row_ * width;
        step_rows_ = 32 / width, step_columns_ = 32 - step_rows_ * width;
    }
    __device__ int rounds() const { return (rows_ * width_ + 31) / 32; }
    /// Returns the offset of this lane's next element from the warp's first row, or -1. Sets `row` and `column` to its
    /// position.
    __device__ int next(int& row, int& column) {
        row = row_ < rows_ ? list_[row_] : 0;
        const int at = row_ < rows_ ? row * width_ + column_ : -1;
        column = column_;
        row_ += step_rows_, column_ += step_columns_;
        if (column_ >= width_) column_ -= width_, ++row_;
        return at;
    }

  private:
    const std::uint8_t* list_;
    int width_, rows_, row_, column_, step_rows_, step_columns_;
};

/// Begins to copy the rows of a warp selected by `mask` to shared memory, at the same offsets. The rows are complete
/// after wait_for_rows.
__device__ inline void begin_rows(unsigned mask, int width, std::uint8_t* list, const float* from, float* to) {
    if (mask == ~0u) {  // all rows of a warp are copied 16 bytes at a time, on 16-byte boundaries
        for (int k = 4 * (threadIdx.x & 31); k < 32 * width; k += 128) __pipeline_memcpy_async(to + k, from + k, 16);
    } else {
        RowElements elements(mask, width, list);
        for (int done = 0, rounds = elements.rounds(); done < rounds; ++done) {
            int row, column;
            const int at = elements.next(row, column);
            if (at >= 0) __pipeline_memcpy_async(to + at, from + at, 4);
        }
    }
    __pipeline_commit();
}
/// Waits for the row copies that the warp has begun.
__device__ inline void wait_for_rows() {
    __pipeline_wait_prior(0);
    __syncwarp();
}

/// Copies rows as begin_rows does, and waits for them.
__device__ inline void load_rows(unsigned mask, int width, std::uint8_t* list, const float* from, float* to) {
    begin_rows(mask, width, list, from, to);
    wait_for_rows();
}

/// Number of loads in flight per lane and array, if values pass through registers.
inline constexpr int kRowUnroll = 8;

/// Copies the rows of a warp selected by `mask` from half precision to shared memory, at the same offsets.
__device__ inline void load_rows(unsigned mask, int width, std::uint8_t* list, const __half* __restrict__ from,
                                 float* to) {
    if (mask == ~0u) {
        for (int k = threadIdx.x & 31; k < 16 * width; k += 32)
            reinterpret_cast<float2*>(to)[k] = __half22float2(reinterpret_cast<const __half2*>(from)[k]);
        __syncwarp();
        return;
    }
    RowElements elements(mask, width, list);
    for (int done = 0, rounds = elements.rounds(); done < rounds; done += kRowUnroll) {
        int at[kRowUnroll], row, column;
        __half x[kRowUnroll];
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u) {
            at[u] = elements.next(row, column);
            if (at[u] >= 0) x[u] = from[at[u]];
        }
#pragma unroll
        for (int u = 0; u < kRowUnroll; ++u)
            if (at[u] >= 0) to[at[u]] = __half2float(x[u]);
    }
    __syncwarp();
}

/// Copies the rows of a warp selected by `mask` from shared memory, to the same offsets.
__device__ inline void store_rows(unsigned mask, int width, std::uint8_t* list, const float* from,
                                  float* __restrict__ to) {
    RowElements elements(mask, width, list);
    for (int done = 0, rounds = elements.rounds(); done < rounds; ++done) {
        int row, column;
        const int at = elements.next(row, column);
        if (at >= 0) to[at] = from[at];
    }
    __syncwarp();
}

/// Applies the steps that the rows in `mask` have missed (lazy_adam.h), in shared memory only. `sums` holds T_t(k) of
/// each row, in shared memory.
__device__ inline void catch_up_rows(unsigned mask, int width, std::uint8_t* list, const float* sums, float epsilon,
                                     const MomentRows& moments, float* parameters) {
    constexpr int kUnroll = 4;
    RowElements elements(mask, width, list);
    for (int done = 0, rounds = elements.rounds(); done < rounds; done += kUnroll) {
        int at[kUnroll], row[kUnroll], column;
        float mm[kUnroll], vv[kUnroll];
#pragma unroll
        for (int u = 0; u < kUnroll; ++u) {
            at[u] = elements.next(row[u], column);
            if (at[u] >= 0) moments.load(at[u], mm[u], vv[u]);
        }
#pragma unroll
        for (int u = 0; u < kUnroll; ++u) {
            if (at[u] < 0) continue;
            moments.unpack(mm[u], vv[u]);
            parameters[at[u]] = catch_up_parameter(parameters[at[u]], mm[u], vv[u], sums[row[u]], epsilon);
        }
    }
    __syncwarp();
}

}  // namespace gs
