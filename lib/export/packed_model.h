// SPDX-License-Identifier: Apache-2.0
// A packed scene as the renderer can draw it, and its colours as a viewer computes them.
#pragma once

#include "kernels/model/gaussian_state.h"
#include "lib/export/ngsplat.h"

namespace gs {

/// Base colour before the activation, its shift included: what the residual is added to.
Vec3<double> packed_base(const PackedScene& scene, std::int64_t row);

/// Colour of one Gaussian, seen along the unit vector `direction` from the camera to it. Evaluated in double from the decoded payload.
Vec3<double> packed_color(const PackedScene& scene, std::int64_t row, const Vec3<double>& direction);

/// Decoded geometry as a model without view dependence (plain_sh_appearance(0)). Its base colours are for set_packed_colors to fill.
Gaussians packed_geometry(const PackedScene& scene);

/// Gives `model`, of packed_geometry, the colours that the scene shows to a camera at `position`.
void set_packed_colors(const PackedScene& scene, const Vec3<double>& position, Gaussians& model);

}  // namespace gs
