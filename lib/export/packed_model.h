// SPDX-License-Identifier: Apache-2.0
// Decodes a packed scene into a model for the renderer, and computes colours as a viewer does.
#pragma once

#include "kernels/state/gaussian_state.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// Returns the base colour before the activation, with its shift and without the residual.
Vec3<double> packed_base(const PackedScene& scene, std::int64_t row);

/// Returns the colour of one Gaussian seen along the unit vector `direction` from the camera to it, in double from the
/// decoded payload.
Vec3<double> packed_color(const PackedScene& scene, std::int64_t row, const Vec3<double>& direction);

/// Returns the decoded geometry as a model without view dependence (plain_sh_appearance(0)). Its base colours are set
/// by set_packed_colors.
Gaussians packed_geometry(const PackedScene& scene);

/// Sets the base colours of `model`, made by packed_geometry, to the colours seen by a camera at `position`.
void set_packed_colors(const PackedScene& scene, const Vec3<double>& position, Gaussians& model);

}  // namespace gs
