// SPDX-License-Identifier: Apache-2.0
// Makes renders and photographs comparable: rounds and composites them as the evaluation protocols require, or aligns
// colours by an affine map.
#pragma once

#include <Eigen/Core>

#include "kernels/ranks/backend.h"
#include "lib/io/image.h"

namespace gs {

/// Returns a render as 8-bit rgb: clamped to [0,1], times 255, plus 0.5, truncated. NaN becomes 0.
Image quantized_render(const RenderedImage& render);

/// Returns a photograph as 8-bit rgb: composited over `background` if it has alpha, then rounded like the render. 8-bit
/// rgb is returned unchanged.
Image quantized_target(const Image& image, const Vec3<float>& background);

/// Returns a render as float rgb, clamped to [0,1]. NaN becomes 0.
Image float_render(const RenderedImage& render);

/// Returns a photograph as float rgb, composited as in quantized_target and clamped to [0,1].
Image float_target(const Image& image, const Vec3<float>& background);

/// Matrix A of the map photograph = A (red, green, blue, 1).
using ColourMap = Eigen::Matrix<double, 3, 4>;

/// Fits the affine colour map of least squared error to all pixels added so far.
class ColourFit {
  public:
    /// Adds the pixels of two images of equal size. The photograph must have at least 3 channels.
    void add(const RenderedImage& render, const Image& photograph);
    /// Returns the best map. If the pixels allow several, returns the map of smallest norm.
    ColourMap solve() const;

  private:
    Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> right_ = Eigen::Matrix<double, 4, 3>::Zero();
};

/// Replaces every colour of `render` by its value under `map`.
void apply_colours(const ColourMap& map, RenderedImage& render);

}  // namespace gs
