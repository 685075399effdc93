// SPDX-License-Identifier: Apache-2.0
// Structural similarity of two images (SSIM).
#pragma once

#include <string>

#include "lib/io/image.h"

namespace gs {

/// The treatment of 11x11 windows that leave the image. The three conventions in circulation differ by up to 0.004.
enum class SsimBorder {
    kValid,    ///< only windows inside the image count: torchmetrics up to 1.4.1
    kReflect,  ///< all pixels count, the image is mirrored without repeating its edge: torchmetrics from 1.4.2
    kZero      ///< all pixels count, with zeros outside: 3DGS metrics
};

/// Returns the mean SSIM over pixels and channels of two images with values in [0,1]. The window is a Gaussian of 11x11
/// pixels with sigma 1.5; k1 = 0.01, k2 = 0.03; variances are clamped at 0. Images below 11 pixels in either direction
/// are treated as kZero. Throws UsageError when sizes differ. The result does not depend on the number of threads.
/// Source: docs/evaluation.md#protocols.
double ssim(const Image& a, const Image& b, SsimBorder border);

/// Parses valid | reflect | zero. Throws UsageError naming these.
SsimBorder parse_ssim_border(const std::string& name);

/// Returns one sentence for the protocol in results.json.
std::string describe_ssim(SsimBorder border);

}  // namespace gs
