// SPDX-License-Identifier: Apache-2.0
// Gaussian-tile pairs on the CPU, and depth as a sort key. The key is the same on both backends, so that both blend in
// the same order.
#pragma once

#include <cstdint>
#include <cstring>

#include "kernels/base/portable.h"

namespace gs {

/// One (Gaussian, tile) pair.
struct Instance {
    std::uint32_t gaussian;
    std::uint32_t slot;  ///< position in Gaussian-major order: the instances of one Gaussian are neighbours there
};

inline constexpr int kDepthKeyBits = 24;
/// Keys of depths between near and far are smaller than this, which fits into the bits, too.
inline constexpr std::uint32_t kDepthKeyEnd = (1u << kDepthKeyBits) - 1;

/// Turns a depth into a key of 24 bits. The bits of positive floats order like the floats, and depths between near and
/// far do not need all 32. The lowest are dropped until 24 are left, which saves one of four passes of a radix sort.
/// The relative resolution is 1e-6 where near is 0.2 and far 10000. Gaussians closer together than that are blended in
/// the order of their indices.
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
