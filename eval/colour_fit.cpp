// SPDX-License-Identifier: Apache-2.0
#include "eval/colour_fit.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

namespace gs {
namespace {

/// Powers 2^(k/35), k = -35..35: steps of 2 %.
constexpr int kPowerSteps = 35;

Eigen::Vector4d color_at(const RenderedImage& render, std::size_t pixel, double power) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    Eigen::Vector4d color(render.rgb[pixel], render.rgb[pixels + pixel], render.rgb[2 * pixels + pixel], 1);
    if (power != 1)
        for (int c = 0; c < 3; ++c) color[c] = std::pow(std::max(color[c], 0.0), power);
    return color;
}

}  // namespace

void ColourFit::add(const RenderedImage& render, const Image& photograph) {
    for (int y = 0; y < render.height; ++y) {
        for (int x = 0; x < render.width; ++x) {
            const Eigen::Vector4d color = color_at(render, std::size_t(y) * render.width + x, power_);
            const Eigen::Vector3d wanted(photograph.value(x, y, 0), photograph.value(x, y, 1), photograph.value(x, y, 2));
            normal_ += color * color.transpose();
            right_ += color * wanted.transpose();
            squares_ += wanted.squaredNorm();
        }
    }
}

ColourMap ColourFit::solve() const {
    Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix4d> decomposition;
    decomposition.setThreshold(1e-9);
    decomposition.compute(normal_);
    return {power_, decomposition.solve(right_).transpose()};
}

double ColourFit::error(const ColourMap& map) const {
    return squares_ - 2 * (map.affine * right_).trace() + (map.affine * normal_ * map.affine.transpose()).trace();
}

PowerFit::PowerFit() {
    for (int k = -kPowerSteps; k <= kPowerSteps; ++k) fits_.emplace_back(std::exp2(double(k) / kPowerSteps));
}

void PowerFit::add(const RenderedImage& render, const Image& photograph) {
    for (ColourFit& fit : fits_) fit.add(render, photograph);
}

ColourMap PowerFit::solve() const {
    ColourMap best;
    double least = std::numeric_limits<double>::infinity();
    for (const ColourFit& fit : fits_) {
        const ColourMap map = fit.solve();
        if (const double error = fit.error(map); error < least) best = map, least = error;
    }
    return best;
}

void apply_colours(const ColourMap& map, RenderedImage& render) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
        const Eigen::Vector3d color = map.affine * color_at(render, pixel, map.power);
        for (std::size_t c = 0; c < 3; ++c) render.rgb[c * pixels + pixel] = float(color[Eigen::Index(c)]);
    }
}

}  // namespace gs
