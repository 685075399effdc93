// SPDX-License-Identifier: Apache-2.0
// Converts renders and photographs to comparable images, and fits colour maps by least squares over pixels.
#include "eval/metrics/quantize.h"

#include <Eigen/QR>

namespace gs {
namespace {

std::uint8_t quantize(float v) {
    if (!(v > 0)) return 0;
    return std::uint8_t(gs_min(v, 1.0f) * 255.0f + 0.5f);
}

/// Clamps to [0,1]. NaN becomes 0.
float clamped(float v) { return v > 0 ? gs_min(v, 1.0f) : 0.0f; }

/// Returns an rgb image of sample(x, y, c), rounded to 8 bits if `eight_bit`.
template <class Sample> Image filled_rgb(int width, int height, bool eight_bit, const Sample& sample) {
    Image image{width, height, 3, {}, {}};
    const std::size_t size = std::size_t(width) * height * 3;
    if (eight_bit)
        image.u8.resize(size);
    else
        image.f32.resize(size);
    std::size_t i = 0;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            for (int c = 0; c < 3; ++c, ++i) {
                if (eight_bit)
                    image.u8[i] = quantize(sample(x, y, c));
                else
                    image.f32[i] = clamped(sample(x, y, c));
            }
        }
    }
    return image;
}

Image comparable_render(const RenderedImage& render, bool eight_bit) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    return filled_rgb(render.width, render.height, eight_bit,
                      [&](int x, int y, int c) { return render.rgb[c * pixels + std::size_t(y) * render.width + x]; });
}

Image comparable_target(const Image& image, const Vec3<float>& background, bool eight_bit) {
    const float behind[3] = {background.x, background.y, background.z};
    return filled_rgb(image.width, image.height, eight_bit, [&](int x, int y, int c) {
        const float alpha = image.channels == 4 ? image.value(x, y, 3) : 1.0f;
        return behind[c] + alpha * (image.value(x, y, c) - behind[c]);
    });
}

Eigen::Vector4d color_at(const RenderedImage& render, std::size_t pixel) {
    const std::size_t pixels = std::size_t(render.width) * render.height;
    return {render.rgb[pixel], render.rgb[pixels + pixel], render.rgb[2 * pixels + pixel], 1};
}

}  // namespace

Image quantized_render(const RenderedImage& render) { return comparable_render(render, true); }

Image quantized_target(const Image& image, const Vec3<float>& background) {
    if (!image.is_float() && image.channels == 3) return image;
    return comparable_target(image, background, true);
}

Image float_render(const RenderedImage& render) { return comparable_render(render, false); }

Image float_target(const Image& image, const Vec3<float>& background) {
    return comparable_target(image, background, false);
}

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
