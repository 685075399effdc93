// SPDX-License-Identifier: Apache-2.0
// The degenerate cases of NASG and NASGabor for the stability measurement.
#pragma once

#include "appearance/stability_case.h"

namespace gs::appearance {

/// Returns the cases of one lobe: the axis and its antipode, exactly and at distances of 1e-8 to 1e-3, for lobes from
/// uniform to the narrowest; frames whose angles are at their limits; values at and around every limit. Model is Nasg
/// or Nasgabor.
template <class Model> StabilityPlan lobe_stability();

}  // namespace gs::appearance
