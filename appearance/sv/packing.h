// SPDX-License-Identifier: Apache-2.0
// SV in files for viewers: seven halves per site, the direction to it as a unit vector, temperature, colour
// (docs/formats.md#scenengsplat).
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

const Packing& sv_packing();

}  // namespace gs::appearance
