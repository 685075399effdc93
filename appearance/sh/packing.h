// SPDX-License-Identifier: Apache-2.0
// SH in files for viewers: coefficients of 7, 8 and 6 bits in bands 1, 2 and 3 (docs/formats.md#scenengsplat).
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

/// The bits of a coefficient of band 1..3, and 32-bit words of a Gaussian in the band's texture, as in packing.json.
inline constexpr int kPackedShBits[3] = {7, 8, 6}, kPackedShWords[3] = {2, 4, 4};

/// Sets field `f` of `bits` bits, two's complement, of fields that lie one behind the other from the lowest bit on.
void set_field(std::uint32_t* words, int bits, int f, int value);
int get_field(const std::uint32_t* words, int bits, int f);

const Packing& sh_packing();

}  // namespace gs::appearance
