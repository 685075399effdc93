// SPDX-License-Identifier: Apache-2.0
// Depth as a sort key, the same on both backends, so that both blend in the same order.
#pragma once

#include <cstdint>
#include <cstring>

#include "kernels/core/portable.h"

namespace gs {

inline constexpr int kDepthKeyBits = 24;
/// Larger than every key: culled Gaussians sort last.
inline constexpr std::uint32_t kCulledKey = (1u << kDepthKeyBits) - 1;

/// The bits of a positive float order like the float, and between near and far not all 32 of them are needed. The lowest are
/// dropped until 24 are left: three passes of a radix sort instead of four, for a relative resolution of 1e-6 where near is
/// 0.2 and far 10000. Gaussians closer together than that are blended in the order of their indices.
struct DepthKey {
    std::uint32_t near_bits, shift;

    static DepthKey of(float near_plane, float far_plane) {
        DepthKey k{bits(near_plane), 0};
        while (((bits(far_plane) - k.near_bits) >> k.shift) >= kCulledKey) ++k.shift;
        return k;
    }
    /// depth in [near, far].
    GS_HD std::uint32_t operator()(float depth) const { return (bits(depth) - near_bits) >> shift; }

  private:
    static GS_HD std::uint32_t bits(float x) {
#ifdef __CUDA_ARCH__
        return __float_as_uint(x);
#else
        std::uint32_t u;
        std::memcpy(&u, &x, sizeof u);
        return u;
#endif
    }
};

}  // namespace gs
