// SPDX-License-Identifier: Apache-2.0
// Degenerate cases of the neural models for the stability measurement.
#pragma once

#include "appearance/stability_case.h"

namespace gs::appearance {

/// Neurons at exactly 0, all off, and all on; outputs saturated either way; weights at their limit.
template <class Model> StabilityPlan network_stability();

}  // namespace gs::appearance
