// SPDX-License-Identifier: Apache-2.0
// Peak signal-to-noise ratio (PSNR).
#pragma once

#include "lib/io/image.h"

namespace gs {

/// Returns 10 log10(1 / MSE) in dB over all pixels and channels of two images of equal size with values in [0,1];
/// infinity for identical images. Throws UsageError when sizes differ. Source: docs/evaluation.md#protocols.
double psnr(const Image& a, const Image& b);

/// Throws UsageError naming both sizes unless the images have the same width, height and channels and are not empty.
void require_same_size(const Image& a, const Image& b);

}  // namespace gs
