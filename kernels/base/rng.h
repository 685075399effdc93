// SPDX-License-Identifier: Apache-2.0
// Counter-based random numbers (Philox4x32-10). A value depends only on (seed, stream, index). So there is no generator
// state to store, resuming is exact, and results do not depend on the number of threads.
// Source: Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
#pragma once

#include "kernels/base/portable.h"

namespace gs {

/// The use of a random number. It is part of the counter, so that different uses never share numbers.
enum class RngStream : std::uint32_t {
    kViewOrder = 1,
    kNoise,
    kRelocate,
    kGrow,
    kSplit,
    kInitPoints,
    kBackground,
    kScene,
    kInitWeights,
    kHostile,
    kController,
    kAsPinholes
};

/// One block of 128 random bits.
struct Philox4 {
    std::uint32_t v[4];
};

GS_HD Philox4 philox(std::uint64_t seed, RngStream stream, std::uint64_t major, std::uint32_t minor) {
    // Counter = (major, minor, stream); key = seed.
    std::uint32_t c0 = std::uint32_t(major), c1 = std::uint32_t(major >> 32), c2 = minor, c3 = std::uint32_t(stream);
    std::uint32_t k0 = std::uint32_t(seed), k1 = std::uint32_t(seed >> 32);
    for (int round = 0; round < 10; ++round) {
        const std::uint64_t p0 = std::uint64_t(0xD2511F53u) * c0, p1 = std::uint64_t(0xCD9E8D57u) * c2;
        const std::uint32_t n0 = std::uint32_t(p1 >> 32) ^ c1 ^ k0, n2 = std::uint32_t(p0 >> 32) ^ c3 ^ k1;
        c0 = n0;
        c1 = std::uint32_t(p1);
        c2 = n2;
        c3 = std::uint32_t(p0);
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    return {{c0, c1, c2, c3}};
}

/// Returns a number uniform in (0, 1), never 0 or 1.
template <class T = float> GS_HD T uniform_from_bits(std::uint32_t bits) {
    return (T(bits >> 9) + T(0.5)) * T(1.0 / 8388608.0);  // 23 bits: adding the half is exact in float
}

/// Computes four standard normals from one Philox block (Box-Muller).
GS_HD void normals_from(const Philox4& r, float out[4]) {
    for (int k = 0; k < 2; ++k) {
        const float radius = ::sqrtf(-2.0f * ::logf(uniform_from_bits<float>(r.v[2 * k])));
        const float angle = 6.28318530717958648f * uniform_from_bits<float>(r.v[2 * k + 1]);
        out[2 * k] = radius * ::cosf(angle);
        out[2 * k + 1] = radius * ::sinf(angle);
    }
}

}  // namespace gs
