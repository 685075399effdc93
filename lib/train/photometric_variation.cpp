// SPDX-License-Identifier: Apache-2.0
// Measures how much photographs differ in exposure and white balance.
#include "lib/train/photometric_variation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "lib/core/median.h"
#include "lib/scene/camera_params.h"

namespace gs {
namespace {

/// Enough images for a standard deviation to within 9 %.
constexpr std::size_t kMaxImages = 64;
constexpr int kGrid = 4, kBlocks = kGrid * kGrid;
/// The mean value below which a block is only noise and rounding.
constexpr double kDark = 0.02;
/// An image with fewer blocks left says nothing about its scatter and is not used.
constexpr int kFewestBlocks = 4;

using Blocks = std::array<std::optional<double>, kBlocks>;

/// Returns log2 of image over render for each block of one channel.
Blocks log_ratios(const ViewImage& image, const RenderedImage& render, const Vec3<float>& background, int channel) {
    const Image& color = image.color;
    const double behind = channel == 0 ? background.x : channel == 1 ? background.y : background.z;
    std::array<double, kBlocks> truth{}, rendered{}, weight{};
    const std::size_t pixels = std::size_t(render.width) * render.height;
    for (int y = 0; y < color.height; ++y) {
        for (int x = 0; x < color.width; ++x) {
            const std::size_t pixel = std::size_t(y) * color.width + x;
            const double alpha = color.channels == 4 ? color.value(x, y, 3) : 1,
                         w = alpha * (image.mask ? image.mask->u8[pixel] / 255.0 : 1);
            const auto block = std::size_t(y * kGrid / color.height * kGrid + x * kGrid / color.width);
            truth[block] += w * (behind + alpha * (color.value(x, y, channel) - behind));
            rendered[block] += w * render.rgb[std::size_t(channel) * pixels + pixel];
            weight[block] += w;
        }
    }
    Blocks out;
    for (std::size_t b = 0; b < kBlocks; ++b)
        if (weight[b] > 0 && std::min(truth[b], rendered[b]) > kDark * weight[b])
            out[b] = std::log2(truth[b] / rendered[b]);
    return out;
}

/// Subtracts from each block the median of that block over all images.
void remove_common(std::vector<Blocks>& images) {
    for (std::size_t b = 0; b < kBlocks; ++b) {
        std::vector<double> values;
        for (const Blocks& image : images)
            if (image[b]) values.push_back(*image[b]);
        if (values.empty()) continue;
        const double common = median(values);
        for (Blocks& image : images)
            if (image[b]) *image[b] -= common;
    }
}

/// Returns the variance between images less that of the mean of an image's blocks.
double variance_of_images(const std::vector<Blocks>& images) {
    double sum = 0, sum_squares = 0, scatter = 0, count = 0;
    for (const Blocks& image : images) {
        double n = 0, s = 0, ss = 0;
        for (const auto& value : image)
            if (value) ++n, s += *value, ss += *value * *value;
        if (n < kFewestBlocks) continue;
        const double mean = s / n;
        scatter += std::max(0.0, ss / n - mean * mean) / (n - 1);
        sum += mean, sum_squares += mean * mean, ++count;
    }
    if (count < 2) return 0;
    const double mean = sum / count;
    return std::max(0.0, (sum_squares - count * mean * mean) / (count - 1) - scatter / count);
}

bool same_pixels(const Image& a, const Image& b) {
    return a.width == b.width && a.height == b.height && a.u8 == b.u8 && a.f32 == b.f32;
}

}  // namespace

PhotometricVariation measure_variation(Backend& backend, const std::vector<View>& views, const Vec3<float>& background,
                                       const std::function<std::shared_ptr<const ViewImage>(std::size_t)>& image) {
    PhotometricVariation out;
    const std::size_t used = std::min(views.size(), kMaxImages);
    if (used < 2) {
        out.nothing_to_tell = "there is only one training image";
        return out;
    }
    std::array<std::vector<Blocks>, 3> channels;
    std::shared_ptr<const ViewImage> first;
    bool all_equal = true;
    for (std::size_t k = 0; k < used; ++k) {
        const std::size_t index = k * views.size() / used;
        const auto photograph = image(index);
        if (!first) first = photograph;
        all_equal = all_equal && same_pixels(first->color, photograph->color);
        RenderRequest request;
        request.camera = camera_params(views[index].camera);
        request.background = background;
        RenderedImage render;
        backend.render(request, render);
        for (int c = 0; c < 3; ++c) channels[std::size_t(c)].push_back(log_ratios(*photograph, render, background, c));
    }
    out.num_images = int(used);
    if (all_equal) {
        out.nothing_to_tell = "all training images have the same pixels";
        return out;
    }
    double variance = 0;
    for (auto& images : channels) {
        remove_common(images);
        variance += variance_of_images(images) / 3;
    }
    out.stops = std::sqrt(variance);
    return out;
}

}  // namespace gs
