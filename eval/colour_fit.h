// SPDX-License-Identifier: Apache-2.0
// Maps of colours that bring renders closest to photographs.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "kernels/backend.h"
#include "lib/io/image.h"

namespace gs {

/// photograph = A (red^p, green^p, blue^p, 1).
struct ColourMap {
    double power = 1;
    Eigen::Matrix<double, 3, 4> affine = Eigen::Matrix<double, 3, 4>::Identity();
};

/// The affine map of least squares over all pixels added so far, for one power.
class ColourFit {
  public:
    explicit ColourFit(double power = 1) : power_(power) {}
    /// Both of one size; the photograph as 8-bit rgb.
    void add(const RenderedImage& render, const Image& photograph);
    /// Where the pixels leave it open, the one with the smallest entries.
    ColourMap solve() const;
    /// Sum of squared differences that `map`, the result of solve, leaves.
    double error(const ColourMap& map) const;

  private:
    double power_, squares_ = 0;
    Eigen::Matrix4d normal_ = Eigen::Matrix4d::Zero();
    Eigen::Matrix<double, 4, 3> right_ = Eigen::Matrix<double, 4, 3>::Zero();
};

/// The same with the best power in 1/2..2, to 2 %. A correction with exposures and a response leaves it open: a scene of another
/// contrast, its exposures stretched alike, gives the same pictures.
class PowerFit {
  public:
    PowerFit();
    void add(const RenderedImage& render, const Image& photograph);
    ColourMap solve() const;

  private:
    std::vector<ColourFit> fits_;
};

void apply_colours(const ColourMap& map, RenderedImage& render);

}  // namespace gs
