// SPDX-License-Identifier: Apache-2.0
// Splats on their way through shared memory to the warps that blend them. Only the .cu files of this folder include it.
//
// A splat is copied as it is stored, without passing registers. Warps of the forward pass list the addresses of splats
// in shared memory: to compute them from numbers took five of 28 instructions a splat.
#pragma once

#include "kernels/blend/blend_device.h"
#include "kernels/splat/splat_cuda.h"

namespace gs {

/// What blending reads of a PackedSplat.
struct StagedSplat {
    float mx, my, qa, qb;
    float qc, opacity, red, green, blue;

    FragmentShape<float> __device__ shape() const { return {mx, my, qa, qb, qc, opacity}; }
};

__device__ inline unsigned shared_address(const void* x) { return unsigned(__cvta_generic_to_shared(x)); }

__device__ inline float4 load_shared4(unsigned at) {
    float4 x;
    asm volatile("ld.shared.v4.f32 {%0,%1,%2,%3}, [%4];"
                 : "=f"(x.x), "=f"(x.y), "=f"(x.z), "=f"(x.w)
                 : "r"(at)
                 : "memory");
    return x;
}
__device__ inline float2 load_shared2(unsigned at) {
    float2 x;
    asm volatile("ld.shared.v2.f32 {%0,%1}, [%2];" : "=f"(x.x), "=f"(x.y) : "r"(at) : "memory");
    return x;
}
/// Loads a splat whose address all lanes of a warp, or of a part of it, have.
__device__ inline StagedSplat load_splat(unsigned at) {
    const float4 a = load_shared4(at), b = load_shared4(at + 16);
    const float2 c = load_shared2(at + 32);
    return {a.x, a.y, a.z, a.w, b.x, b.y, b.w, c.x, c.y};
}

/// Begins to copy a splat to shared memory, where wait_for_splat() ends it.
__device__ inline void begin_splat(PackedSplat& to, const PackedSplat& from) {
#pragma unroll
    for (unsigned k = 0; k < sizeof(PackedSplat); k += 16)
        asm volatile("cp.async.cg.shared.global [%0], [%1], 16;" ::"r"(shared_address(&to) + k),
                     "l"(reinterpret_cast<const char*>(&from) + k)
                     : "memory");
}
__device__ inline void wait_for_splat() { asm volatile("cp.async.wait_all;" ::: "memory"); }

}  // namespace gs
