// SPDX-License-Identifier: Apache-2.0
// Rendered images against a renderer without tiles, and at the extremes.
#include <gtest/gtest.h>
#include <cmath>
#include <cstring>

#include "appearance/none/none.h"
#include "kernels/base/error.h"
#include "kernels/reference_image.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/random_scene.h"

namespace gs::test {
namespace {

const Vec3<double> kBackground{0.3, 0.6, 0.1};

template <class Real> void compare_with_brute_force(int width, int height, std::int64_t n, double tolerance) {
    const auto camera = test_camera(width, height);
    const auto s = random_gaussians(n, 3, 31 + width);
    Pipeline<Real, appearance::Sh> pipe;
    pipe.render(cast<Real>(s), cast<Real>(camera), {Real(kBackground.x), Real(kBackground.y), Real(kBackground.z)});
    const BruteForce brute(s, camera);
    double worst = 0, worst_share = 0;
    int compared = 0;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const std::size_t i = std::size_t(y) * width + x, plane = std::size_t(width) * height;
            const auto error = [&](const Vec3<double>& c) {
                return std::max({std::abs(double(pipe.image[i]) - c.x), std::abs(double(pipe.image[i + plane]) - c.y),
                                 std::abs(double(pipe.image[i + 2 * plane]) - c.z)});
            };
            // Same rules, no tiles: equal to rounding, except where rounding decides about a fragment.
            const BruteForcePixel same = brute.pixel(x, y, kBackground, true);
            if (same.threshold_distance > 1e-4) {
                worst = std::max(worst, error(same.color));
                ++compared;
            }
            // No truncation: removing a fragment changes the pixel by T alpha |c - behind| <= alpha c_max, and
            // stopping at T < 1e-4 by at most 1e-4 c_max, so the sum of both bounds the difference.
            const BruteForcePixel exact = brute.pixel(x, y, kBackground, false);
            const double bound = (exact.dropped_alpha + 1e-4) * std::max(1.0, brute.max_color()) + tolerance;
            EXPECT_LE(error(exact.color), bound) << x << "," << y;
            worst_share = std::max(worst_share, error(exact.color) / bound);
        }
    EXPECT_LE(worst, tolerance);
    EXPECT_GE(compared, width * height * 9 / 10);
    std::printf("%dx%d, %d Gaussians: max error %.2e (bound %.0e); truncation uses %.0f %% of its bound\n", width,
                height, int(n), worst, tolerance, 100 * worst_share);
}

TEST(Render, EqualsBruteForceInDouble) {
    compare_with_brute_force<double>(33, 25, 40, 1e-11);
    compare_with_brute_force<double>(70, 50, 200, 1e-11);
}

TEST(Render, EqualsBruteForceInFloat) {
    // 200 blended fragments, each a few float roundings of values below 3.
    compare_with_brute_force<float>(33, 25, 40, 2e-5);
    compare_with_brute_force<float>(70, 50, 200, 2e-5);
    compare_with_brute_force<float>(1, 1, 20, 2e-5);
    compare_with_brute_force<float>(17, 13, 60, 2e-5);
}

TEST(Render, LanesAndScalarAgree) {
    // Evaluates one fragment through sixteen float lanes and through a plain float.
    for (const float alpha_raw : {-3.0f, 0.0f, 4.0f}) {
        Splat<float> s{};
        s.mean = {3.2f, 1.7f}, s.a = 0.4f, s.b = 0.1f, s.c = 0.3f, s.opacity = sigmoid(alpha_raw);
        Lanes<float> px, py;
        for (int k = 0; k < kLanes; ++k) px.set(k, 0.5f + k % 4), py.set(k, 0.5f + k / 4);
        const auto lanes = fragment_alpha(FragmentShape<Lanes<float>>::from(s), px, py);
        for (int k = 0; k < kLanes; ++k) {
            const auto one = fragment_alpha(FragmentShape<float>::from(s), px[k], py[k]);
            EXPECT_NEAR(lanes.alpha[k], one.alpha, 4e-7f * one.alpha);
        }
    }
}

TEST(Render, ExpOfLanesIsAccurate) {
    double worst = 0;
    for (double x = -125; x <= 0; x += 0.00371) {
        const double got = exp2_nonpositive(Lanes<float>(float(x)))[3], want = std::exp2(double(float(x)));
        worst = std::max(worst, std::abs(got - want) / want);
    }
    EXPECT_LT(worst, 2e-7);
    EXPECT_LT(exp2_nonpositive(Lanes<float>(-1e30f))[0], 1e-37f);
    EXPECT_EQ(exp2_nonpositive(Lanes<float>(5.0f))[0], 1.0f);
}

// Is a tile or block that holds a visible pixel ever called untouched?
TEST(TileTest, NeverMissesAVisiblePixel) {
    std::mt19937 rng(5);
    std::uniform_real_distribution<float> u(0, 1);
    int touched = 0, wasted = 0;
    for (int trial = 0; trial < 20000; ++trial) {
        Splat<float> s{};
        const float l1 = std::exp(8 * u(rng) - 2), l2 = std::exp(8 * u(rng) - 2), angle = 6.3f * u(rng);
        const float c = std::cos(angle), n = std::sin(angle), xx = c * c * l1 + n * n * l2 + 0.3f,
                    yy = n * n * l1 + c * c * l2 + 0.3f, xy = c * n * (l1 - l2);
        const float det = xx * yy - xy * xy;
        s.a = yy / det, s.b = -xy / det, s.c = xx / det;
        s.mean = {60 * u(rng) - 22, 60 * u(rng) - 22};
        if (trial % 10 == 0)
            s.mean = {std::floor(s.mean.x) + 0.5f, std::floor(s.mean.y) + 0.5f};  // exactly on a pixel centre
        s.opacity = 0.004f + u(rng) * 0.996f;
        s.threshold = std::max(std::log(255 * s.opacity), 0.0f);
        const unsigned mask = BlockGeometry<float>(0, 0).touched(s);
        const bool tile = min_power_in_rectangle(s, 0.0f, 0.0f, 15.0f, 15.0f) <= touch_threshold(s);
        unsigned needed = 0;
        for (int y = 0; y < 16; ++y)
            for (int x = 0; x < 16; ++x)
                if (fragment_alpha(FragmentShape<float>::from(s), x + 0.5f, y + 0.5f).alpha >= float(kMinAlpha))
                    needed |= 1u << (block_order(x, y) / 16);
        EXPECT_EQ(needed & ~mask, 0u) << "trial " << trial;
        EXPECT_TRUE(tile || !needed);
        touched += __builtin_popcount(mask), wasted += __builtin_popcount(mask & ~needed);
    }
    EXPECT_LT(wasted, touched / 10);  // exact up to pixel centres that the ellipse passes between
}

GaussianState<double> one_gaussian() {
    auto s = random_gaussians(1, 3, 2);
    for (double& x : s[Group::kMean].param) x = 0;
    for (double& x : s[Group::kScale].param) x = -1;
    s[Group::kOpacity].param[0] = 3;
    return s;
}

/// Renders, expects finite pixels and finite gradients; returns the largest deviation from the background.
double deviation_from_background(const GaussianState<double>& d, int width = 17, int height = 13) {
    const auto s = cast<float>(d);
    const auto camera = cast<float>(test_camera(width, height));
    Pipeline<float, appearance::Sh> pipe;
    pipe.render(s, camera, {0.5f, 0.25f, 0.125f});
    double worst = 0;
    const std::size_t plane = pipe.image.size() / 3;
    for (std::size_t i = 0; i < pipe.image.size(); ++i) {
        EXPECT_TRUE(std::isfinite(pipe.image[i]));
        worst = std::max(worst, std::abs(double(pipe.image[i]) - (i < plane ? 0.5 : i < 2 * plane ? 0.25 : 0.125)));
    }
    const auto w = random_weights(pipe.image.size(), 3);
    const auto g = pipe.gradients(s, std::vector<float>(w.begin(), w.end()));
    for (int k = 0; k < kNumGroups; ++k)
        for (float x : g.groups[k].param) EXPECT_TRUE(std::isfinite(x)) << kGroupNames[k];
    return worst;
}

TEST(RenderExtremes, NothingToShowIsTheBackground) {
    EXPECT_EQ(deviation_from_background(random_gaussians(0, 3, 1)), 0);
    auto s = one_gaussian();
    EXPECT_GT(deviation_from_background(s), 0.1);
    const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
    const auto with = [&](Group g, std::vector<double> values) {
        auto t = one_gaussian();
        t[g].param = std::move(values);
        return deviation_from_background(t);
    };
    EXPECT_EQ(with(Group::kMean, {0, 0, -50}), 0) << "behind the camera";
    EXPECT_EQ(with(Group::kMean, {nan, 0, 0}), 0);
    EXPECT_EQ(with(Group::kMean, {inf, 0, 0}), 0);
    const auto camera = test_camera(17, 13);
    EXPECT_EQ(with(Group::kMean, {camera.position.x, camera.position.y, camera.position.z}), 0)
        << "at the camera centre";
    const Vec3<double> on_plane = camera.rotation.transposed_times(Vec3<double>{1, 1, 0} - camera.translation);
    EXPECT_EQ(with(Group::kMean, {on_plane.x, on_plane.y, on_plane.z}), 0) << "on the camera plane";
    EXPECT_EQ(with(Group::kScale, {nan, 0, 0}), 0);
    EXPECT_EQ(with(Group::kScale, {60, 60, 60}), 0) << "variance beyond 1e12 square pixels";
    EXPECT_EQ(with(Group::kScale, {1e30, 0, 0}), 0);
    EXPECT_EQ(with(Group::kRotation, {0, 0, 0, 0}), 0);
    EXPECT_EQ(with(Group::kRotation, {nan, 0, 0, 1}), 0);
    EXPECT_EQ(with(Group::kOpacity, {-50}), 0);
    EXPECT_EQ(with(Group::kOpacity, {nan}), 0);
    EXPECT_EQ(with(Group::kOpacity, {-1e30}), 0);
}

TEST(RenderExtremes, ReachesTheRightLimits) {
    auto s = one_gaussian();
    s[Group::kOpacity].param[0] = 50;  // alpha 1 at the centre
    EXPECT_GT(deviation_from_background(s), 0.2);
    for (double& x : s[Group::kScale].param) x = -30;  // a dot of the size of the reconstruction filter
    EXPECT_GT(deviation_from_background(s), 1e-3);
    EXPECT_GT(deviation_from_background(s, 1, 1), -1);
    // A Gaussian much larger than the image paints its colour everywhere: e^9 units = far beyond 17 pixels.
    auto wide = one_gaussian();
    for (double& x : wide[Group::kScale].param) x = 9;
    wide[Group::kOpacity].param[0] = 0;
    Pipeline<float, appearance::Sh> pipe;
    pipe.render(cast<float>(wide), cast<float>(test_camera(17, 13)), {0, 0, 0});
    for (std::size_t i = 1; i < pipe.image.size() / 3; ++i) EXPECT_NEAR(pipe.image[i], pipe.image[0], 1e-5f);
    EXPECT_NEAR(pipe.transmittance[0], 0.5f, 1e-5f);
    // Far off axis just beyond the near plane: pixel coordinates of 1e7 must not wrap to an int.
    auto far = one_gaussian();
    const auto camera = test_camera(17, 13);
    const Vec3<double> p = camera.rotation.transposed_times(Vec3<double>{1e6, 0, 0.21} - camera.translation);
    far[Group::kMean].param = {p.x, p.y, p.z};
    EXPECT_EQ(deviation_from_background(far), 0);
}

TEST(RenderExtremes, TooManyInstancesAreRefused) {
    auto d = random_gaussians(2000, 0, 5);
    for (double& x : d[Group::kScale].param) x = 3;
    for (double& x : d[Group::kOpacity].param) x = 3;
    const auto s = cast<float>(d);
    const auto camera = cast<float>(test_camera(320, 320));
    CpuRasterizer<float, appearance::None> raster(10000);
    std::vector<float> image(3 * 320 * 320), t(320 * 320);
    EXPECT_THROW(
        raster.forward(ParameterView<float>::of(s), camera, {0, 0, 0}, 0, RenderMode::kFull, image.data(), t.data()),
        DeviceError);
    EXPECT_LE(default_max_instances(), (std::int64_t(1) << 31) - 1);
}

TEST(Render, ManyGaussiansInOneTileStopAtTheTransmittanceLimit) {
    auto s = random_gaussians(5000, 0, 8);
    for (double& x : s[Group::kMean].param) x *= 0.05;
    for (double& x : s[Group::kOpacity].param) x = 2;
    compare_with_brute_force<float>(16, 16, 10, 2e-5);
    Pipeline<double, appearance::Sh> pipe;
    const auto camera = test_camera(16, 16);
    pipe.render(s, camera, {0, 0, 0});
    const BruteForce brute(s, camera);
    const auto c = brute.pixel(7, 8, {0, 0, 0}, true).color;
    EXPECT_NEAR(pipe.image[8 * 16 + 7], c.x, 1e-9);
}

TEST(Render, IsIndependentOfTheNumberOfThreads) {
    const auto s = cast<float>(random_gaussians(5000, 3, 12));
    const auto camera = cast<float>(test_camera(150, 90));
    const auto w = random_weights(3 * 150 * 90, 4);
    const std::vector<float> weights(w.begin(), w.end());
    std::vector<float> image;
    GaussianState<float> gradients;
    for (int threads : {1, 2, 5}) {
        set_num_threads(threads);
        Pipeline<float, appearance::Sh> pipe;
        pipe.render(s, camera, {0, 0, 0});
        const auto g = pipe.gradients(s, weights);
        if (threads == 1) {
            image = pipe.image, gradients = g;
            continue;
        }
        EXPECT_EQ(0, std::memcmp(image.data(), pipe.image.data(), image.size() * sizeof(float)));
        for (int k = 0; k < kNumGroups; ++k) EXPECT_EQ(gradients.groups[k].param, g.groups[k].param) << kGroupNames[k];
    }
    set_num_threads(0);
}

// Medians of pixels against a renderer without tiles.

const Vec3<float> kMedianBackground{0.3f, 0.6f, 0.1f};

RenderRequest median_request(int width, int height) {
    RenderRequest r;
    r.camera = cast<float>(test_camera(width, height));
    r.background = kMedianBackground;
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
