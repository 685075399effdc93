// SPDX-License-Identifier: Apache-2.0
#include "eval/held_out.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "eval/colour_fit.h"
#include "eval/quantize.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

/// Mask values from which a pixel counts.
constexpr int kCounts = 128;

/// The pixels that count, in one row.
struct Pixels {
    RenderedImage render;
    Image photograph;
};

Pixels counted_pixels(const RenderedImage& render, const Image& photograph, const std::optional<Image>& mask) {
    Pixels p;
    const std::size_t pixels = std::size_t(render.width) * render.height;
    std::vector<std::size_t> counted;
    for (std::size_t i = 0; i < pixels; ++i)
        if (!mask || mask->u8[i] >= kCounts) counted.push_back(i);
    p.render.width = p.photograph.width = int(counted.size()), p.render.height = p.photograph.height = 1;
    p.photograph.channels = 3;
    for (std::size_t c = 0; c < 3; ++c)
        for (const std::size_t i : counted) p.render.rgb.push_back(render.rgb[c * pixels + i]);
    for (const std::size_t i : counted)
        for (std::size_t c = 0; c < 3; ++c) p.photograph.u8.push_back(photograph.u8[3 * i + c]);
    return p;
}

double mean_squared(const Pixels& p) {
    double sum = 0;
    const std::size_t pixels = std::size_t(p.render.width);
    for (std::size_t c = 0; c < 3; ++c)
        for (std::size_t i = 0; i < pixels; ++i) {
            const double d = std::clamp(double(p.render.rgb[c * pixels + i]), 0.0, 1.0) - double(p.photograph.u8[3 * i + c]) / 255;
            sum += d * d;
        }
    return sum / double(3 * pixels);
}

}  // namespace

ViewErrors view_errors(Backend& backend, const std::vector<View>& views, const Vec3<float>& background) {
    ViewErrors sum;
    double count = 0;
    for (const View& view : views) {
        const ViewImage image = view.load();
        RenderRequest request{.camera = camera_params(view.camera), .background = background};
        request.isp = {.mode = IspMode::kFrame, .camera = std::max(0, view.camera_id)};
        RenderedImage render;
        backend.render(request, render);
        Pixels pixels = counted_pixels(render, quantized_target(image.color, background), image.mask);
        if (pixels.render.width == 0) continue;
        ++count;
        const double error = mean_squared(pixels);
        ColourFit fit;
        fit.add(pixels.render, pixels.photograph);
        apply_colours(fit.solve(), pixels.render);
        const double aligned = mean_squared(pixels);
        sum.error += error, sum.aligned_error += aligned;
        sum.psnr -= 10 * std::log10(error), sum.aligned_psnr -= 10 * std::log10(aligned);
    }
    if (count == 0) count = std::numeric_limits<double>::quiet_NaN();
    return {sum.psnr / count, sum.aligned_psnr / count, sum.error / count, sum.aligned_error / count};
}

}  // namespace gs
