// SPDX-License-Identifier: Apache-2.0
// Least squares over pixels, for one map of colours.
#include "eval/metrics/colour_fit.h"

#include <Eigen/QR>

namespace gs {
namespace {

Eigen::Vector4d color_at(const RenderedImage& render, std::size_t pixel) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    return {render.rgb[pixel], render.rgb[pixels + pixel], render.rgb[2 * pixels + pixel], 1};
}

}  // namespace

void ColourFit::add(const RenderedImage& render, const Image& photograph) {
    for (int y = 0; y < render.height; ++y) {
        for (int x = 0; x < render.width; ++x) {
            const Eigen::Vector4d color = color_at(render, std::size_t(y) * render.width + x);
            const Eigen::Vector3d wanted(photograph.value(x, y, 0), photograph.value(x, y, 1),
                                         photograph.value(x, y, 2));
            normal_ += color * color.transpose();
            right_ += color * wanted.transpose();
        }
    }
}

ColourMap ColourFit::solve() const {
    Eigen::CompleteOrthogonalDecomposition<Eigen::Matrix4d> decomposition;
    decomposition.setThreshold(1e-9);
    decomposition.compute(normal_);
    return decomposition.solve(right_).transpose();
}

void apply_colours(const ColourMap& map, RenderedImage& render) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    for (std::size_t pixel = 0; pixel < pixels; ++pixel) {
        const Eigen::Vector3d color = map * color_at(render, pixel);
        for (std::size_t c = 0; c < 3; ++c) render.rgb[c * pixels + pixel] = float(color[Eigen::Index(c)]);
    }
}

}  // namespace gs
