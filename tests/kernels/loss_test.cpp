// SPDX-License-Identifier: Apache-2.0
// L1 + D-SSIM: values from the definition, gradient by finite differences, masks, alpha, degenerate sizes.
#include <gtest/gtest.h>

#include <random>

#include "kernels/base/parallel.h"
#include "kernels/loss/loss.h"

namespace gs {
namespace {

struct Fixture {
    int w, h, channels;
    std::vector<double> image;
    std::vector<std::uint8_t> target, mask;
    Vec3<float> background{0.2f, 0.5f, 0.8f};

    Fixture(int width, int height, int c, std::uint32_t seed) : w(width), h(height), channels(c) {
        std::mt19937 rng(seed);
        std::uniform_real_distribution<double> u(-0.1, 1.2);
        image.resize(3 * w * h);
        for (double& x : image) x = u(rng);
        target.resize(std::size_t(w) * h * channels);
        for (auto& x : target) x = std::uint8_t(rng() % 256);
    }
    TargetImage view() const {
        return {w, h, channels, target.data(), nullptr, mask.empty() ? nullptr : mask.data(), {}};
    }
    double target_value(int x, int y, int c) const {
        const std::uint8_t* p = &target[(std::size_t(y) * w + x) * channels];
        if (channels == 3) return p[c] / 255.0;
        const double a = p[3] / 255.0, bg[3] = {background.x, background.y, background.z};
        return a * p[c] / 255.0 + (1 - a) * bg[c];
    }
};

/// Computes SSIM and L1 straight from the definition: 2-D window, zero padding.
std::pair<double, double> brute_force(const Fixture& f) {
    double taps[11], sum = 0, l1 = 0, ssim = 0, weights = 0;
    for (int k = 0; k < 11; ++k) sum += taps[k] = std::exp(-(k - 5) * (k - 5) / 4.5);
    const auto m = [&](int x, int y) { return f.mask.empty() ? 1.0 : f.mask[y * f.w + x] / 255.0; };
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < f.h; ++y)
            for (int x = 0; x < f.w; ++x) {
                double e[5] = {};
                for (int j = -5; j <= 5; ++j)
                    for (int i = -5; i <= 5; ++i) {
                        if (x + i < 0 || y + j < 0 || x + i >= f.w || y + j >= f.h) continue;
                        const double g = taps[i + 5] * taps[j + 5] / (sum * sum);
                        const double a = m(x + i, y + j) * f.image[(c * f.h + y + j) * f.w + x + i],
                                     b = m(x + i, y + j) * f.target_value(x + i, y + j, c);
                        e[0] += g * a, e[1] += g * b, e[2] += g * a * a, e[3] += g * b * b, e[4] += g * a * b;
                    }
                const double C1 = 1e-4, C2 = 9e-4;
                const double s = (2 * e[0] * e[1] + C1) * (2 * (e[4] - e[0] * e[1]) + C2) /
                                 ((e[0] * e[0] + e[1] * e[1] + C1) * (e[2] - e[0] * e[0] + e[3] - e[1] * e[1] + C2));
                ssim += m(x, y) * s;
                l1 += m(x, y) * std::abs(f.image[(c * f.h + y) * f.w + x] - f.target_value(x, y, c));
                weights += m(x, y);
            }
    return {l1 / weights, ssim / weights};
}

void check_values(const Fixture& f) {
    ImageLoss<double> loss;
    std::vector<double> gradient(f.image.size());
    const ViewLoss v = loss.compute(f.image.data(), f.view(), f.background, {}, gradient.data());
    const auto [l1, ssim] = brute_force(f);
    EXPECT_NEAR(v.l1, l1, 1e-7);  // the background is float
    EXPECT_NEAR(v.ssim, ssim, 1e-7);
    EXPECT_NEAR(v.loss, 0.8 * l1 + 0.2 * (1 - ssim), 1e-7);
}

void check_gradient(Fixture f, float lambda) {
    const LossWeights weights{.lambda_dssim = lambda};
    ImageLoss<double> loss;
    std::vector<double> gradient(f.image.size()), scratch(f.image.size());
    loss.compute(f.image.data(), f.view(), f.background, weights, gradient.data());
    double scale = 0;
    for (double g : gradient) scale = std::max(scale, std::abs(g));
    for (std::size_t k = 0; k < f.image.size(); ++k) {
        const double h = 1e-6, x = f.image[k];
        f.image[k] = x + h;
        const double up = loss.compute(f.image.data(), f.view(), f.background, weights, scratch.data()).loss;
        f.image[k] = x - h;
        const double down = loss.compute(f.image.data(), f.view(), f.background, weights, scratch.data()).loss;
        f.image[k] = x;
        EXPECT_NEAR((up - down) / (2 * h), gradient[k], 1e-6 * scale) << k;
    }
}

TEST(Loss, EqualsTheDefinition) {
    check_values(Fixture(23, 17, 3, 1));
    check_values(Fixture(40, 9, 4, 2));
    check_values(Fixture(1, 1, 3, 3));
    check_values(Fixture(5, 30, 3, 4));
}

TEST(Loss, MaskedEqualsTheDefinition) {
    Fixture f(23, 17, 3, 5);
    f.mask.resize(23 * 17);
    for (std::size_t i = 0; i < f.mask.size(); ++i) f.mask[i] = i % 3 ? 255 : std::uint8_t(i % 100);
    check_values(f);
    check_gradient(f, 0.2f);
}

TEST(Loss, GradientMatchesFiniteDifferences) {
    for (float lambda : {0.0f, 0.2f, 1.0f}) check_gradient(Fixture(19, 14, 3, 6), lambda);
    check_gradient(Fixture(14, 12, 4, 7), 0.2f);
    check_gradient(Fixture(1, 1, 3, 8), 0.2f);
}

TEST(Loss, FloatAgreesWithDouble) {
    Fixture f(64, 48, 3, 9);
    ImageLoss<double> reference;
    ImageLoss<float> loss;
    std::vector<double> want(f.image.size());
    std::vector<float> got(f.image.size()), image(f.image.begin(), f.image.end());
    const ViewLoss a = reference.compute(f.image.data(), f.view(), f.background, {}, want.data());
    const ViewLoss b = loss.compute(image.data(), f.view(), f.background, {}, got.data());
    EXPECT_NEAR(a.loss, b.loss, 1e-6);
    double scale = 0, worst = 0;
    for (std::size_t i = 0; i < want.size(); ++i)
        scale = std::max(scale, std::abs(want[i])), worst = std::max(worst, std::abs(want[i] - got[i]));
    // The variance E[x^2]-mu^2 loses about 1e-7 of values near 1 against C2 = 9e-4: relative 1e-4 of the largest.
    EXPECT_LT(worst, 2e-4 * scale);
}

TEST(Loss, PerfectRenderHasNoLossAndNoGradient) {
    Fixture f(20, 20, 3, 10);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < 20; ++y)
            for (int x = 0; x < 20; ++x) f.image[(c * 20 + y) * 20 + x] = f.target[(y * 20 + x) * 3 + c] / 255.0;
    ImageLoss<double> loss;
    std::vector<double> g(f.image.size(), 1);
    EXPECT_NEAR(loss.compute(f.image.data(), f.view(), f.background, {}, g.data()).loss, 0, 1e-12);
    for (double x : g) EXPECT_NEAR(x, 0, 1e-9);
}

TEST(Loss, EmptyMaskGivesZero) {
    Fixture f(8, 8, 3, 11);
    f.mask.assign(64, 0);
    ImageLoss<double> loss;
    std::vector<double> g(f.image.size(), 1);
    EXPECT_EQ(loss.compute(f.image.data(), f.view(), f.background, {}, g.data()).loss, 0);
    for (double x : g) EXPECT_EQ(x, 0);
}

TEST(Loss, IsIndependentOfTheNumberOfThreads) {
    Fixture f(200, 131, 3, 12);
    std::vector<float> image(f.image.begin(), f.image.end()), first(image.size()), other(image.size());
    ImageLoss<float> loss;
    set_num_threads(1);
    const double a = loss.compute(image.data(), f.view(), f.background, {}, first.data()).loss;
    set_num_threads(3);
    const double b = loss.compute(image.data(), f.view(), f.background, {}, other.data()).loss;
    set_num_threads(0);
    EXPECT_EQ(a, b);
    EXPECT_EQ(first, other);
}

}  // namespace
}  // namespace gs
