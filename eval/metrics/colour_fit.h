// SPDX-License-Identifier: Apache-2.0
// Affine maps of colours that bring renders closest to photographs.
#pragma once

#include <Eigen/Core>

#include "kernels/ranks/backend.h"
#include "lib/io/image.h"

namespace gs {

/// The matrix A of the map photograph = A (red, green, blue, 1).
using ColourMap = Eigen::Matrix<double, 3, 4>;

/// Finds the affine map that fits all pixels added so far best in the least-squares sense.
class ColourFit {
  public:
    /// Adds the pixels of two images of one size. The photograph has at least 3 channels.
    void add(const RenderedImage& render, const Image& photograph);
    /// Returns the best map. Where the pixels allow several, it is the one with the smallest entries.
    ColourMap solve() const;

  private:
    Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> right_ = Eigen::Matrix<double, 4, 3>::Zero();
};

/// Replaces every colour of `render` by its image under `map`.
void apply_colours(const ColourMap& map, RenderedImage& render);

}  // namespace gs
