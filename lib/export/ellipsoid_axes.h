// SPDX-License-Identifier: Apache-2.0
// Chooses the order and direction in which an ellipsoid's axes are stored.
#pragma once

#include "lib/export/geometry_codes.h"

namespace gs {

/// An ellipsoid has 24 descriptions: its axes in any order and direction, as long as they are right-handed. Replaces
/// rotation and scale by the description whose rounded rotation changes the outline least; turning equal axes into each
/// other changes nothing. The new rotation has length 1.
void choose_axes(PackedGeometry& geometry);

}  // namespace gs
