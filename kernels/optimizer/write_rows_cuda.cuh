// SPDX-License-Identifier: Apache-2.0
// Writes the rows that a warp has updated. If each lane wrote its own row of three values, every 32-byte sector of the
// array would be written three times in parts, and sectors are the scarce resource of the L2 cache.
#pragma once

#include "kernels/optimizer/update_device.h"

namespace gs {

/// Writes the rows of the warp's 32 Gaussians, 16 bytes a lane. All lanes must construct it alike and call it.
class WarpRowWriter {
  public:
    /// `first` is the warp's first Gaussian, a multiple of 32.
    __device__ WarpRowWriter(const ModelArrays& arrays, std::int64_t first)
        : arrays_(arrays), first_(first), lane_(threadIdx.x & 31) {}

    template <int kWidth> __device__ void operator()(const Row<kWidth>& row) const {
        const int k = int(row.group);
        write(arrays_.param[k] + first_ * kWidth, row.p);
        write(arrays_.m[k] + first_ * kWidth, row.m);
        write(arrays_.v[k] + first_ * kWidth, row.v);
    }

  private:
    __device__ void write(float* to, const float (&x)[1]) const { to[lane_] = x[0]; }
    __device__ void write(float* to, const float (&x)[4]) const {
        reinterpret_cast<float4*>(to)[lane_] = make_float4(x[0], x[1], x[2], x[3]);
    }
    /// Lane L < 24 writes values 4 L .. 4 L + 3 of the 96. The j-th of them comes from lane (4 L + j) / 3, which
    /// provides its value whose index is j modulo 4.
    __device__ void write(float* to, const float (&x)[3]) const {
        float y[4];
#pragma unroll
        for (int j = 0; j < 4; ++j) {
            const int c = (j + lane_) & 3;  // (j - 3 lane) mod 4; 3 where the lane has no value for j
            y[j] = __shfl_sync(~0u, c == 0 ? x[0] : c == 1 ? x[1] : x[2], (4 * lane_ + j) / 3 & 31);
        }
        if (lane_ < 24) reinterpret_cast<float4*>(to)[lane_] = make_float4(y[0], y[1], y[2], y[3]);
    }

    const ModelArrays& arrays_;
    std::int64_t first_;
    int lane_;
};

}  // namespace gs
