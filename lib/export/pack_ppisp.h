// SPDX-License-Identifier: Apache-2.0
// Photometric correction as a viewer applies it: response of the first camera, exposure and colour, no vignetting.
#pragma once

#include "kernels/requests.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// Response of the first camera, and exposure and colour of the training image of median exposure for free views. `state` is active.
/// Without views.
PackedPpisp pack_ppisp(const PpispState& state);

/// Exposure and colour of a view: what its camera's controller says of its uncorrected render, or zeros where the mode is kFrame.
PackedFrame packed_frame(const PpispState& state, const IspView& view, const RenderedImage& uncorrected);

}  // namespace gs
