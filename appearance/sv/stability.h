// SPDX-License-Identifier: Apache-2.0
// Degenerate cases of SV for the stability measurement.
#pragma once

#include "appearance/stability_case.h"

namespace gs::appearance {

/// Views at a site and at its antipode, exactly and at distances of 1e-8 to 1e-3; coincident, opposite, short, zero and huge
/// sites; temperatures around the limit; the limits of all temperatures hot and all cold.
StabilityPlan sv_stability();

}  // namespace gs::appearance
