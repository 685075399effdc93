// SPDX-License-Identifier: Apache-2.0
// Packs the photometric correction that a viewer applies: response of the first camera, exposure and colour, no
// vignetting.
#pragma once

#include "kernels/requests.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// Packs the response of the first camera and, for free views, exposure and colour of the training image of median
/// exposure. `views` stays empty. `state` must be active.
PackedPpisp pack_ppisp(const PpispState& state);

/// Returns exposure and colour of a view. With the mode kController its camera's controller predicts them from the
/// uncorrected render; otherwise they are zero.
PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected);

}  // namespace gs
