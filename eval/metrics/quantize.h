// SPDX-License-Identifier: Apache-2.0
// The images that metrics compare: rounding and compositing of the evaluation protocols.
#pragma once

#include "kernels/backend.h"
#include "lib/io/image.h"

namespace gs {

/// 8-bit rgb of a render: clamp to [0,1], *255, +0.5, truncate. NaN becomes 0.
Image quantized_render(const RenderedImage& render);

/// 8-bit rgb of a photograph: alpha, if any, composited on `background`, then rounded like the render. 8-bit rgb passes
/// unchanged.
Image quantized_target(const Image& image, const Vec3<float>& background);

/// The same without rounding: float rgb, clamped to [0,1]; NaN becomes 0.
Image float_render(const RenderedImage& render);

/// Float rgb of a photograph, composited like quantized_target, clamped to [0,1].
Image float_target(const Image& image, const Vec3<float>& background);

}  // namespace gs
