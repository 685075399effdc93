// SPDX-License-Identifier: Apache-2.0
// The degenerate cases of SV for the stability measurement.
#pragma once

#include "appearance/stability_case.h"

namespace gs::appearance {

/// Returns views at a site and at its antipode, exactly and at distances of 1e-8 to 1e-3; coincident, opposite, short,
/// zero and huge sites; temperatures around the limit; all temperatures so high or so low that the residual is at an
/// exact limit.
StabilityPlan sv_stability();

}  // namespace gs::appearance
