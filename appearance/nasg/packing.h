// SPDX-License-Identifier: Apache-2.0
// Lobes in files for viewers: 12 halves per lobe, 13 with a carrier (docs/formats.md#scenengsplat).
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

/// The largest normalization that is stored. The rest of a larger one becomes a factor of the amplitude: only their
/// product shows.
inline constexpr double kLargestPackedNorm = 6e4;

/// The packing of Nasg or Nasgabor.
template <class Model> const Packing& lobe_packing();

}  // namespace gs::appearance
