// SPDX-License-Identifier: Apache-2.0
// Structural similarity of two images.
#pragma once

#include <string>

#include "lib/io/image.h"

namespace gs {

/// What happens where the 11x11 window leaves the image. The three conventions in circulation differ by up to 0.004.
enum class SsimBorder {
    kValid,    ///< only windows inside the image count: torchmetrics up to 1.4.1
    kReflect,  ///< the image is mirrored without repeating its edge, all pixels count: torchmetrics from 1.4.2
    kZero      ///< zeros outside, all pixels count: 3DGS metrics
};

/// Mean SSIM over pixels and channels; values in [0,1], Gaussian window 11x11 with sigma 1.5, k1 = 0.01, k2 = 0.03,
/// variances clamped at 0. Images below 11 pixels in either direction are treated as kZero. Throws UsageError when sizes
/// differ. Independent of the number of threads. Source: docs/evaluation.md#protocols.
double ssim(const Image& a, const Image& b, SsimBorder border);

/// valid | reflect | zero. Throws UsageError naming these.
SsimBorder parse_ssim_border(const std::string& name);

/// One sentence for the protocol in results.json.
std::string describe_ssim(SsimBorder border);

}  // namespace gs
