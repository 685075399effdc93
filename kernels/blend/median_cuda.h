// SPDX-License-Identifier: Apache-2.0
// The medians of a view's pixels on the device (docs/math/rasterizer.md#median).
#pragma once

#include "kernels/blend/blend_cuda.h"

namespace gs {

/// Replaces the colours of a view that was blended into `image` by those of the pixels' medians; 0 where transmittance
/// stays above 1/2.
void write_medians(const CudaBins& bins, const PackedSplat* splats, const BlendImage& image, cudaStream_t stream);

}  // namespace gs
