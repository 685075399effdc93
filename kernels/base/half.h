// SPDX-License-Identifier: Apache-2.0
// Half precision on the host, for files and viewers.
#pragma once

#include <bit>
#include <cstdint>

#include "kernels/base/half_range.h"

namespace gs {

/// Returns the bits of the nearest half, ties to even. Values are clamped to +-kLargestHalf, so that a file never holds
/// an infinity. NaN stays NaN.
inline std::uint16_t half_bits(double x) {
    const double limited = x > kLargestHalf ? kLargestHalf : (x < -kLargestHalf ? -kLargestHalf : x);
    return std::bit_cast<std::uint16_t>(static_cast<_Float16>(limited));
}

inline double half_value(std::uint16_t bits) { return double(std::bit_cast<_Float16>(bits)); }

}  // namespace gs
