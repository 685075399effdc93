// SPDX-License-Identifier: Apache-2.0
// FLIP for low dynamic range: how visible a difference is when two images alternate on a screen.
#pragma once

#include <string>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// A 4K screen 0.7 m wide, seen from 0.7 m: 67 pixels per degree (67.02), the authors' default.
inline constexpr double kFlipPixelsPerDegree = 3840 * 3.14159265358979323846 / 180;

/// The FLIP error of each pixel (H,W) in [0,1], 0 where the images agree; symmetric. sRGB images with values in [0,1] (clamped)
/// and 3 channels, of any size; pixels beyond the border repeat it. Double precision, the same for any number of threads.
/// Throws UsageError when sizes differ, there are not 3 channels, or pixels_per_degree is not in [1, 1000].
/// Source: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; constants as in the authors' program.
std::vector<double> flip_map(const Image& a, const Image& b, double pixels_per_degree = kFlipPixelsPerDegree);

/// Mean of flip_map.
double flip(const Image& a, const Image& b, double pixels_per_degree = kFlipPixelsPerDegree);

/// One sentence for the protocol in results.json.
std::string describe_flip(double pixels_per_degree);

}  // namespace gs
