// SPDX-License-Identifier: Apache-2.0
// Toy in files for viewers: the nine numbers of the matrix as halves.
#pragma once

#include "appearance/packing.h"

namespace gs::appearance {

const Packing& toy_packing();

}  // namespace gs::appearance
