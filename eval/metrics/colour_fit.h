// SPDX-License-Identifier: Apache-2.0
// Maps of colours that bring renders closest to photographs.
#pragma once

#include <Eigen/Core>

#include "kernels/backend.h"
#include "lib/io/image.h"

namespace gs {

/// photograph = A (red, green, blue, 1).
using ColourMap = Eigen::Matrix<double, 3, 4>;

/// The affine map of least squares over all pixels added so far.
class ColourFit {
  public:
    /// Both of one size; the photograph as 8-bit rgb.
    void add(const RenderedImage& render, const Image& photograph);
    /// Where the pixels leave it open, the one with the smallest entries.
    ColourMap solve() const;

  private:
    Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> right_ = Eigen::Matrix<double, 4, 3>::Zero();
};

void apply_colours(const ColourMap& map, RenderedImage& render);

}  // namespace gs
