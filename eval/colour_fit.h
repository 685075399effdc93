// SPDX-License-Identifier: Apache-2.0
// The affine map of colours that brings renders closest to photographs.
#pragma once

#include <Eigen/Core>

#include "kernels/backend.h"
#include "lib/io/image.h"

namespace gs {

/// photograph = A (red, green, blue, 1) in the least-squares sense, over all pixels added so far.
class ColourFit {
  public:
    /// Both of one size; the photograph as 8-bit rgb.
    void add(const RenderedImage& render, const Image& photograph);
    /// A, 3x4. Where the pixels leave it open, the one with the smallest entries.
    Eigen::Matrix<double, 3, 4> solve() const;

  private:
    Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> right_ = Eigen::Matrix<double, 4, 3>::Zero();
};

void apply_colours(const Eigen::Matrix<double, 3, 4>& map, RenderedImage& render);

}  // namespace gs
