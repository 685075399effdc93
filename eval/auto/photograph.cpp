// SPDX-License-Identifier: Apache-2.0
// Loads the pixels of photographs that count, and compares renders with them.
#include "eval/auto/photograph.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "eval/metrics/quantize.h"
#include "kernels/base/parallel.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

/// Smallest mask value for which a pixel counts.
constexpr int kCounts = 128;
/// Mean squared error from rounding colours to 8 bits. Smaller differences are meaningless, and a difference of zero,
/// as in a view of empty space, would outweigh the other photographs in a mean.
constexpr double kRounding = 1.0 / (12 * 255 * 255);

Photograph photograph_of(const View& view, const ViewImage& image, const Vec3<float>& background) {
    const Image color = quantized_target(image.color, background);
    Photograph out{view.camera, view.camera_id, {}, {}};
    const std::int32_t pixels = color.width * color.height;
    for (std::int32_t i = 0; i < pixels; ++i) {
        if (image.mask && image.mask->u8[std::size_t(i)] < kCounts) continue;
        out.pixels.push_back(i);
        for (std::size_t c = 0; c < 3; ++c) out.colors.u8.push_back(color.u8[3 * std::size_t(i) + c]);
    }
    out.colors.width = int(out.pixels.size()), out.colors.height = 1, out.colors.channels = 3;
    return out;
}

}  // namespace

std::vector<Photograph> load_photographs(const std::vector<View>& views, const Vec3<float>& background,
                                         const ImageOf& image) {
    std::vector<Photograph> out(views.size());
    parallel_for(std::int64_t(views.size()), [&](std::int64_t i) {
        const std::size_t k = std::size_t(i);
        out[k] = image ? photograph_of(views[k], *image(k), background)
                       : photograph_of(views[k], *view_image(views[k]), background);
    });
    std::erase_if(out, [](const Photograph& photograph) { return photograph.pixels.empty(); });
    return out;
}

RenderedImage render_pixels(Backend& backend, const Photograph& photograph, const Vec3<float>& background) {
    RenderRequest request{.camera = camera_params(photograph.camera), .background = background};
    request.isp = {.mode = IspMode::kFrame, .camera = std::max(0, photograph.camera_id)};
    RenderedImage whole, out;
    backend.render(request, whole);
    const std::size_t pixels = std::size_t(whole.width) * std::size_t(whole.height);
    out.width = int(photograph.pixels.size()), out.height = 1;
    for (std::size_t c = 0; c < 3; ++c)
        for (const std::int32_t i : photograph.pixels) out.rgb.push_back(whole.rgb[c * pixels + std::size_t(i)]);
    for (const std::int32_t i : photograph.pixels) out.alpha.push_back(whole.alpha[std::size_t(i)]);
    return out;
}

double mean_squared_error(const RenderedImage& pixels, const Photograph& photograph) {
    double sum = 0;
    const std::size_t n = photograph.pixels.size();
    for (std::size_t c = 0; c < 3; ++c)
        for (std::size_t i = 0; i < n; ++i) {
            const double d =
                std::clamp(double(pixels.rgb[c * n + i]), 0.0, 1.0) - double(photograph.colors.u8[3 * i + c]) / 255;
            sum += d * d;
        }
    return sum / double(3 * n);
}

void align_colours(RenderedImage& pixels, const Photograph& photograph) {
    ColourFit fit;
    fit.add(pixels, photograph.colors);
    apply_colours(fit.solve(), pixels);
}

std::vector<double> psnrs(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                          bool aligned) {
    std::vector<double> all;
    for (const Photograph& photograph : photographs) {
        RenderedImage pixels = render_pixels(backend, photograph, background);
        if (aligned) align_colours(pixels, photograph);
        all.push_back(-10 * std::log10(std::max(mean_squared_error(pixels, photograph), kRounding)));
    }
    return all;
}

double mean_psnr(Backend& backend, const std::vector<Photograph>& photographs, const Vec3<float>& background,
                 bool aligned) {
    if (photographs.empty()) return std::numeric_limits<double>::quiet_NaN();
    const std::vector<double> all = psnrs(backend, photographs, background, aligned);
    return std::accumulate(all.begin(), all.end(), 0.0) / double(all.size());
}

}  // namespace gs
