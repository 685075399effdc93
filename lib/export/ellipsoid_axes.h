// SPDX-License-Identifier: Apache-2.0
// The order and direction in which an ellipsoid's axes are stored.
#pragma once

#include "lib/export/geometry_codes.h"

namespace gs {

/// An ellipsoid has 24 descriptions: its axes in any order and direction, as long as they are right-handed. Replaces rotation and scale by
/// the one whose rotation codes turn it least, as far as that is seen: equal axes may be turned into each other. The rotation has length 1 then.
void choose_axes(PackedGeometry& geometry);

}  // namespace gs
