// SPDX-License-Identifier: Apache-2.0
// From renders and photographs to comparable 8-bit images.
#include "eval/quantize.h"

namespace gs {
namespace {

std::uint8_t quantize(float v) {
    if (!(v > 0)) return 0;
    return std::uint8_t(gs_min(v, 1.0f) * 255.0f + 0.5f);
}

Image empty_rgb(int width, int height) {
    Image image{width, height, 3, {}, {}};
    image.u8.resize(std::size_t(width) * height * 3);
    return image;
}

}  // namespace

Image quantized_render(const RenderedImage& render) {
    Image out = empty_rgb(render.width, render.height);
    const std::size_t pixels = std::size_t(render.width) * render.height;
    for (std::size_t i = 0; i < pixels; ++i) {
        for (std::size_t c = 0; c < 3; ++c) out.u8[3 * i + c] = quantize(render.rgb[c * pixels + i]);
    }
    return out;
}

Image quantized_target(const Image& image, const Vec3<float>& background) {
    if (!image.is_float() && image.channels == 3) return image;
    const float behind[3] = {background.x, background.y, background.z};
    Image out = empty_rgb(image.width, image.height);
    for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
            const float alpha = image.channels == 4 ? image.value(x, y, 3) : 1.0f;
            for (int c = 0; c < 3; ++c) {
                out.u8[(std::size_t(y) * image.width + x) * 3 + c] = quantize(behind[c] + alpha * (image.value(x, y, c) - behind[c]));
            }
        }
    }
    return out;
}

}  // namespace gs
