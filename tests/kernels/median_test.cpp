// SPDX-License-Identifier: Apache-2.0
// Medians of pixels against a renderer without tiles.
#include <gtest/gtest.h>

#include <cmath>

#include "kernels/reference_image.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

const Vec3<float> kBackground{0.3f, 0.6f, 0.1f};

RenderRequest median_request(int width, int height) {
    RenderRequest r;
    r.camera = cast<float>(test_camera(width, height));
    r.background = kBackground;
    r.median = true;
    return r;
}

Gaussians float_scene(const GaussianState<double>& s) {
    Gaussians model = cast<float>(s);
    model.appearance.model = "sh";
    return model;
}

RenderedImage render(const Gaussians& model, const RenderRequest& request) {
    const auto backend = make_cpu_backend(model.appearance);
    backend->upload(model);
    RenderedImage image;
    backend->render(request, image);
    return image;
}

/// Compares with brute force wherever T stays farther from 1/2, and alphas from their cutoff, than `rounding`.
void compare_with_brute_force(const GaussianState<double>& s, int width, int height, const std::vector<double>& image,
                              double rounding, double tolerance) {
    const BruteForce brute(cast<double>(float_scene(s)), cast<double>(cast<float>(test_camera(width, height))));
    const std::size_t plane = std::size_t(width) * height;
    double worst = 0;
    std::size_t compared = 0, with = 0, without = 0;
    for (std::size_t i = 0; i < plane; ++i) {
        const BruteForcePixel p = brute.pixel(int(i) % width, int(i) / width, {}, true);
        if (p.half_distance < rounding || p.threshold_distance < rounding) continue;
        ++compared;
        ++(p.transmittance <= 0.5 ? with : without);
        worst = std::max({worst, std::abs(image[i] - p.median.x), std::abs(image[i + plane] - p.median.y),
                          std::abs(image[i + 2 * plane] - p.median.z)});
    }
    EXPECT_LE(worst, tolerance);
    EXPECT_GE(compared, plane * 9 / 10);
    std::printf("%dx%d: %zu pixels with a median, %zu without; max error %.1e\n", width, height, with, without, worst);
    EXPECT_GT(with, plane / 20) << "else the scene tests nothing";
    EXPECT_GT(without, plane / 20);
}

TEST(Median, EqualsBruteForce) {
    for (const auto& [width, height, count, seed] : {std::array{33, 25, 40, 1}, {70, 50, 60, 2}, {17, 13, 30, 4}}) {
        auto s = random_gaussians(count, 3, std::uint32_t(seed));
        for (double& x : s[Group::kScale].param) x -= 0.5;
        const Gaussians model = float_scene(s);
        const RenderRequest request = median_request(width, height);
        compare_with_brute_force(s, width, height, render_in_double(model, request), 1e-9, 1e-11);
        // T of 60 fragments is off by some roundings of 6e-8 each; the colour is that of one Gaussian.
        const RenderedImage image = render(model, request);
        compare_with_brute_force(s, width, height, {image.rgb.begin(), image.rgb.end()}, 1e-4, 2e-6);
    }
}

TEST(Median, IsWhereAlphaIsAHalfOrMore) {
    auto s = random_gaussians(200, 3, 5);
    for (double& x : s[Group::kScale].param) x -= 1;
    for (double& x : s[Group::kBase].param) x = std::abs(x);  // no colour is 0
    for (double& x : s[Group::kResidual].param) x = 0;
    const RenderRequest request = median_request(90, 61);
    RenderRequest plain = request;
    plain.median = false;
    const RenderedImage median = render(float_scene(s), request), image = render(float_scene(s), plain);
    EXPECT_EQ(median.alpha, image.alpha) << "transmittance is that of all Gaussians";
    for (std::size_t i = 0; i < median.alpha.size(); ++i)
        ASSERT_EQ(median.rgb[i] > 0, median.alpha[i] >= 0.5f) << i << ": neither background nor a fainter Gaussian";
}

}  // namespace
}  // namespace gs::test
