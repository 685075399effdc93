// SPDX-License-Identifier: Apache-2.0
// Finds the range of base colours that a scene's 8-bit codes cover.
#pragma once

#include "appearance/packing.h"
#include "lib/export/geometry_codes.h"

namespace gs {

/// Returns the range whose codes give the smallest error of the activated colour with its packed residual, over a few
/// directions. `shift` is added to the base colours. Returns the default range without Gaussians.
BaseRange find_base_range(const Gaussians& gaussians, double shift, const Packing& packing,
                          const PackedAppearance& packed);

}  // namespace gs
