// SPDX-License-Identifier: Apache-2.0
// Pixel metrics: peak signal-to-noise ratio (PSNR) and structural similarity (SSIM).
#pragma once

#include <string>

#include "lib/io/image.h"

namespace gs {

/// Returns 10 log10(1 / MSE) in dB over all pixels and channels of two images of equal size with values in [0,1];
/// infinity for identical images. Throws UsageError if sizes differ. Source: docs/evaluation.md#protocols.
double psnr(const Image& a, const Image& b);

/// Throws UsageError naming both sizes unless the images have the same width, height and channels and are not empty.
void require_same_size(const Image& a, const Image& b);

/// Treatment of 11x11 windows that extend beyond the image. The three published conventions differ by up to 0.004.
enum class SsimBorder {
    kValid,    ///< only windows inside the image count: torchmetrics up to 1.4.1
    kReflect,  ///< all pixels count, the image is mirrored without repeating its edge: torchmetrics from 1.4.2
    kZero      ///< all pixels count, with zeros outside: 3DGS metrics
};

/// Returns the mean SSIM over pixels and channels of two images with values in [0,1]. The window is a Gaussian of 11x11
/// pixels with sigma 1.5; k1 = 0.01, k2 = 0.03; variances are clamped at 0. Images below 11 pixels in either direction
/// are treated as kZero. Throws UsageError if sizes differ. The result does not depend on the number of threads.
/// Source: docs/evaluation.md#protocols.
double ssim(const Image& a, const Image& b, SsimBorder border);

/// Parses valid | reflect | zero. Throws UsageError listing these.
SsimBorder parse_ssim_border(const std::string& name);

/// Returns the description of the metric for the protocol in results.json, one sentence.
std::string describe_ssim(SsimBorder border);

}  // namespace gs
