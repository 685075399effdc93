// SPDX-License-Identifier: Apache-2.0
// Which base colours the 8-bit codes of a scene cover.
#pragma once

#include "appearance/packing.h"
#include "lib/export/geometry_codes.h"

namespace gs {

/// The range whose codes show the smallest error: that of the colour behind the activation, with the packed residual in some directions.
/// `shift` is added to the base colours. Of no Gaussians any range.
BaseRange find_base_range(const Gaussians& gaussians, double shift, const Packing& packing, const PackedAppearance& packed);

}  // namespace gs
