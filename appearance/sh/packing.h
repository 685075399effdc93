// SPDX-License-Identifier: Apache-2.0
// SH in files for viewers: coefficients of 7, 8 and 6 bits in bands 1, 2 and 3 (docs/formats.md#scenengsplat).
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

/// Bits of a coefficient, and 32-bit words per Gaussian in the band's texture, for bands 1 to 3, as in packing.json.
inline constexpr int kPackedShBits[3] = {7, 8, 6}, kPackedShWords[3] = {2, 4, 4};

/// Sets field `f` of consecutive fields of `bits` bits each, in two's complement, packed from the lowest bit on.
void set_field(std::uint32_t* words, int bits, int f, int value);
int get_field(const std::uint32_t* words, int bits, int f);

const Packing& sh_packing();

}  // namespace gs::appearance
