// SPDX-License-Identifier: Apache-2.0
// Multiplies small half-precision matrices on the tensor cores of one warp: C (16x8, float) += A (16x16) B (16x8).
//
// The elements lie as follows (PTX ISA, mma.m16n8k16), with group = lane / 4, pair = 2 * (lane % 4):
//   A: registers 0 to 3 hold columns pair, pair + 1 of row group, of row group + 8, and the same of columns 8 on;
//   B: registers 0 and 1 hold rows pair, pair + 1 of column group, and rows 8 on;
//   C: values 0, 1 are columns pair, pair + 1 of row group, 2, 3 of row group + 8.
// So two neighbouring C tiles, rounded, are the A operand of the next product.
#pragma once

#include <cuda_fp16.h>

namespace gs::tensor {

/// The magnitude at which values saturate when they become halves. The largest half is 65504.
inline constexpr float kSaturation = 60000.0f;

/// Adds A B to C.
__device__ inline void multiply(float (&c)[4], const unsigned (&a)[4], unsigned b0, unsigned b1) {
    asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
        : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b0), "r"(b1));
}

/// Returns two values as halves, `low` in the lower bits. Values beyond the range of half saturate.
__device__ inline unsigned pack(float low, float high) {
    const __half2 h =
        __floats2half2_rn(fminf(fmaxf(low, -kSaturation), kSaturation), fminf(fmaxf(high, -kSaturation), kSaturation));
    return *reinterpret_cast<const unsigned*>(&h);
}
__device__ inline float2 unpack(unsigned x) { return __half22float2(*reinterpret_cast<const __half2*>(&x)); }

/// Loads a 16x16 piece of a row-major matrix in shared memory as A; `stride` is in halves and a multiple of 8.
__device__ inline void load(unsigned (&r)[4], const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride + (lane >> 4) * 8));
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3])
                 : "r"(at)
                 : "memory");
}
/// Loads such a piece as two B operands: its columns 0 to 7 (registers 0, 1) and 8 to 15 (2, 3).
__device__ inline void load_columns(unsigned (&r)[4], const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride + (lane >> 4) * 8));
    asm volatile("ldmatrix.sync.aligned.m8n8.x4.trans.shared.b16 {%0,%1,%2,%3}, [%4];"
                 : "=r"(r[0]), "=r"(r[1]), "=r"(r[2]), "=r"(r[3])
                 : "r"(at)
                 : "memory");
}
/// Loads a 16x8 piece as registers 0 and 1 of A.
__device__ inline void load_half(unsigned& r0, unsigned& r1, const __half* piece, int stride) {
    const int lane = threadIdx.x & 31;
    const unsigned at = unsigned(__cvta_generic_to_shared(piece + (lane & 15) * stride));
    asm volatile("ldmatrix.sync.aligned.m8n8.x2.shared.b16 {%0,%1}, [%2];" : "=r"(r0), "=r"(r1) : "r"(at) : "memory");
}

/// Returns an 8x8 tile of halves with rows and columns exchanged.
__device__ inline unsigned transpose(unsigned x) {
    unsigned y;
    asm("movmatrix.sync.aligned.m8n8.trans.b16 %0, %1;" : "=r"(y) : "r"(x));
    return y;
}

}  // namespace gs::tensor
