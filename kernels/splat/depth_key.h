// SPDX-License-Identifier: Apache-2.0
// Gaussian-tile pairs on the CPU, and depth as a sort key. Both backends use the same key, so that they blend in the
// same order.
#pragma once

#include <cstdint>
#include <cstring>

#include "kernels/base/portable.h"

namespace gs {

/// One (Gaussian, tile) pair.
struct Instance {
    std::uint32_t gaussian;
    std::uint32_t slot;  ///< position in Gaussian-major order, in which the instances of one Gaussian are consecutive
};

inline constexpr int kDepthKeyBits = 24;
/// Upper bound of the keys of depths between near and far. It fits into the key bits, too.
inline constexpr std::uint32_t kDepthKeyEnd = (1u << kDepthKeyBits) - 1;

/// Converts a depth to a key of 24 bits. Positive floats have the same order as their bits, and depths between near and
/// far do not need all 32 bits. The lowest bits are dropped until 24 are left, which saves one of four passes of a
/// radix sort. The relative resolution is 1e-6 if near is 0.2 and far 10000. Gaussians closer together than that are
/// blended in index order.
struct DepthKey {
    std::uint32_t near_bits, shift;

    static DepthKey of(float near_plane, float far_plane) {
        DepthKey k{bits(near_plane), 0};
        while (((bits(far_plane) - k.near_bits) >> k.shift) >= kDepthKeyEnd) ++k.shift;
        return k;
    }
    /// Returns the key of a depth in [near, far].
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
