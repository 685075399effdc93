// SPDX-License-Identifier: Apache-2.0
// FLIP for low dynamic range: the visibility of a difference when two images alternate on a screen.
#pragma once

#include <string>
#include <vector>

#include "lib/io/image.h"

namespace gs {

/// The authors' default of 67.02 pixels per degree: a 4K screen 0.7 m wide, viewed from 0.7 m.
inline constexpr double kFlipPixelsPerDegree = 3840 * 3.14159265358979323846 / 180;

/// Returns the FLIP error of each pixel (H,W) in [0,1], 0 if the images are equal; symmetric. The images are sRGB of
/// any size with 3 channels; values are clamped to [0,1], and borders are replicated. Computes in double; the result
/// does not depend on the number of threads. Throws UsageError if sizes differ, there are not 3 channels, or
/// pixels_per_degree is not in [1, 1000].
/// Source: Andersson et al. 2020, "FLIP: A Difference Evaluator for Alternating Images"; constants as in the authors'
/// program.
std::vector<double> flip_map(const Image& a, const Image& b, double pixels_per_degree = kFlipPixelsPerDegree);

/// Returns the mean of flip_map.
double flip(const Image& a, const Image& b, double pixels_per_degree = kFlipPixelsPerDegree);

/// Returns the description of the metric for the protocol in results.json, one sentence.
std::string describe_flip(double pixels_per_degree);

}  // namespace gs
