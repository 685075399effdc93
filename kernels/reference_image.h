// SPDX-License-Identifier: Apache-2.0
// The image of a view in double precision, the reference for faster renderers.
#pragma once

#include <vector>

#include "kernels/requests.h"

namespace gs {

/// Renders the view with the CPU rasterizer in double and the cutoffs of 3DGS. Returns planar (3,H,W), not clamped,
/// without photometric correction. Takes about three times as long as a frame of the CPU backend. Throws UsageError for
/// an unknown model.
std::vector<double> render_in_double(const Gaussians& model, const RenderRequest& request);

}  // namespace gs
