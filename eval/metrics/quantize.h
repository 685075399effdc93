// SPDX-License-Identifier: Apache-2.0
// Rounds and composites images as the evaluation protocols compare them.
#pragma once

#include "kernels/ranks/backend.h"
#include "lib/io/image.h"

namespace gs {

/// Returns a render as 8-bit rgb: clamped to [0,1], times 255, plus 0.5, truncated. NaN becomes 0.
Image quantized_render(const RenderedImage& render);

/// Returns a photograph as 8-bit rgb: composited on `background` where it has alpha, then rounded like the render.
/// 8-bit rgb passes unchanged.
Image quantized_target(const Image& image, const Vec3<float>& background);

/// Returns a render as float rgb, clamped to [0,1]. NaN becomes 0.
Image float_render(const RenderedImage& render);

/// Returns a photograph as float rgb, composited like quantized_target and clamped to [0,1].
Image float_target(const Image& image, const Vec3<float>& background);

}  // namespace gs
