// SPDX-License-Identifier: Apache-2.0
// What a view shows in double precision: the measure of everything that computes faster.
#pragma once

#include <vector>

#include "kernels/requests.h"

namespace gs {

/// The view's image, planar (3,H,W), not clamped, without photometric correction, by the CPU's rasterizer in double with the cutoffs of
/// 3DGS. Takes about three times as long as a frame of the CPU backend. Throws UsageError for an unknown model.
std::vector<double> render_in_double(const Gaussians& model, const RenderRequest& request);

}  // namespace gs
