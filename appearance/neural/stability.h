// SPDX-License-Identifier: Apache-2.0
// The degenerate cases of the neural models for the stability measurement.
#pragma once

#include "appearance/stability_case.h"

namespace gs::appearance {

/// Returns cases with neurons at exactly 0, all off, and all on; with outputs saturated either way; with weights at
/// their limit.
template <class Model> StabilityPlan network_stability();

}  // namespace gs::appearance
