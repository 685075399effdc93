// SPDX-License-Identifier: Apache-2.0
// Networks in files for viewers: per Gaussian the first layer's sums over what does not depend on the view, or, where
// that would be more, its encoded features; weights as halves (docs/formats.md#scenengsplat).
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

/// The packing of a network of neural.h.
template <class Model> const Packing& network_packing();

}  // namespace gs::appearance
