// SPDX-License-Identifier: Apache-2.0
// Packs both of Adam's moments of a value into one 32-bit word, as bfloat16.
//
// bfloat16 has float's range and 8 bits of mantissa. A step changes the second moment by a thousandth, which rounding
// to nearest would lose each time. So it is rounded up or down at random, which is unbiased. The random bits come from
// a seed, a hash of the warp and the step, and are spread over the warp's values.
#pragma once

#include <cstdint>

#include "kernels/base/portable.h"

namespace gs {

/// Hashes all bits to all bits (two rounds of multiply and shift).
GS_HD std::uint32_t mix_bits(std::uint32_t x) {
    x = (x ^ x >> 16) * 0x7feb352du;
    x = (x ^ x >> 15) * 0x846ca68bu;
    return x ^ x >> 16;
}

/// Returns the 16 random bits of the k-th value under a seed: multiples of the golden ratio are well spread.
GS_HD std::uint32_t rounding_bits(std::uint32_t seed, std::uint32_t k) { return (seed + k * 0x9e3779b9u) >> 16; }

/// Returns m, rounded to nearest, in the upper half of the word and v in the lower half. v is rounded up if its
/// remainder plus `random` (< 2^16) overflows 16 bits. Both must be finite, with |m| <= 1e38, and v >= 0.
GS_HD std::uint32_t pack_moments(std::uint32_t m_bits, std::uint32_t v_bits, std::uint32_t random) {
    return ((m_bits + 0x8000u) & 0xffff0000u) | (v_bits + random) >> 16;
}

/// Returns the bits of one moment in a word.
GS_HD std::uint32_t first_moment_bits(std::uint32_t word) { return word & 0xffff0000u; }
GS_HD std::uint32_t second_moment_bits(std::uint32_t word) { return word << 16; }

}  // namespace gs
