// SPDX-License-Identifier: Apache-2.0
// PSNR and SSIM against hand-computed values and a brute-force window; rounding to 8 bits.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "eval/metrics/pixel_metrics.h"
#include "eval/metrics/quantize.h"
#include "kernels/base/error.h"
#include "kernels/base/rng.h"

namespace gs {
namespace {

Image noise(int width, int height, std::uint64_t seed, float scale = 1) {
    Image image{width, height, 3, {}, {}};
    image.f32.resize(std::size_t(width) * height * 3);
    for (std::size_t i = 0; i < image.f32.size(); ++i)
        image.f32[i] = scale * uniform_from_bits(philox(seed, RngStream::kScene, i, 0).v[0]);
    return image;
}

Image constant(int width, int height, float value) {
    Image image{width, height, 3, {}, {}};
    image.f32.assign(std::size_t(width) * height * 3, value);
    return image;
}

/// Computes SSIM by its definition: window by window, two-dimensional, with centred sums.
double brute_force_ssim(const Image& a, const Image& b, SsimBorder border) {
    double total = 0, count = 0;
    const auto sample = [&](const Image& image, int x, int y, int c) -> double {
        if (border == SsimBorder::kReflect) {
            if (x < 0) x = -x;
            if (y < 0) y = -y;
            if (x >= image.width) x = 2 * (image.width - 1) - x;
            if (y >= image.height) y = 2 * (image.height - 1) - y;
        }
        const bool inside = x >= 0 && y >= 0 && x < image.width && y < image.height;
        return inside ? double(image.value(x, y, c)) : 0.0;
    };
    const int margin = border == SsimBorder::kValid ? 5 : 0;
    for (int c = 0; c < 3; ++c) {
        for (int y = margin; y < a.height - margin; ++y) {
            for (int x = margin; x < a.width - margin; ++x) {
                double weights = 0, ma = 0, mb = 0, va = 0, vb = 0, cov = 0;
                const auto weight = [](int dx, int dy) { return std::exp(-(dx * dx + dy * dy) / (2 * 1.5 * 1.5)); };
                for (int dy = -5; dy <= 5; ++dy) {
                    for (int dx = -5; dx <= 5; ++dx) {
                        weights += weight(dx, dy);
                        ma += weight(dx, dy) * sample(a, x + dx, y + dy, c),
                            mb += weight(dx, dy) * sample(b, x + dx, y + dy, c);
                    }
                }
                ma /= weights, mb /= weights;
                for (int dy = -5; dy <= 5; ++dy) {
                    for (int dx = -5; dx <= 5; ++dx) {
                        const double w = weight(dx, dy) / weights, da = sample(a, x + dx, y + dy, c) - ma,
                                     db = sample(b, x + dx, y + dy, c) - mb;
                        va += w * da * da, vb += w * db * db, cov += w * da * db;
                    }
                }
                total += (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4));
                count += 1;
            }
        }
    }
    return total / count;
}

TEST(Psnr, HandComputed) {
    EXPECT_NEAR(psnr(constant(3, 2, 0.5f), constant(3, 2, 0.6f)), 20, 1e-5);
    Image one = constant(2, 2, 0.25f);
    one.f32[7] = 0.75f;  // MSE = 0.25 / 12
    EXPECT_NEAR(psnr(constant(2, 2, 0.25f), one), 10 * std::log10(48.0), 1e-9);
    EXPECT_EQ(psnr(one, one), std::numeric_limits<double>::infinity());
    EXPECT_THROW(psnr(constant(2, 2, 0), constant(2, 3, 0)), UsageError);
    EXPECT_THROW(psnr(Image{}, Image{}), UsageError);
}

TEST(Ssim, ConstantImagesHaveTheLuminanceTermOnly) {
    const double expected = (2 * 0.25 * 0.75 + 1e-4) / (0.25 * 0.25 + 0.75 * 0.75 + 1e-4);
    EXPECT_NEAR(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kValid), expected, 1e-9);
    EXPECT_NEAR(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kReflect), expected, 1e-9);
    EXPECT_GT(std::abs(ssim(constant(16, 12, 0.25f), constant(16, 12, 0.75f), SsimBorder::kZero) - expected), 1e-3)
        << "zeros outside are seen";
}

TEST(Ssim, EqualsTheDefinition) {
    const Image a = noise(17, 13, 1);
    Image b = noise(17, 13, 2, 0.3f);
    for (std::size_t i = 0; i < b.f32.size(); ++i) b.f32[i] = 0.7f * a.f32[i] + b.f32[i];
    for (const SsimBorder border : {SsimBorder::kValid, SsimBorder::kReflect, SsimBorder::kZero}) {
        EXPECT_NEAR(ssim(a, b, border), brute_force_ssim(a, b, border), 1e-9) << int(border);
        EXPECT_NEAR(ssim(a, a, border), 1, 1e-12);
    }
}

TEST(Ssim, SmallImagesFallBackToZeroPadding) {
    const Image a = noise(10, 20, 1), b = noise(10, 20, 2);
    for (const SsimBorder border : {SsimBorder::kValid, SsimBorder::kReflect}) {
        EXPECT_NEAR(ssim(a, b, border), brute_force_ssim(a, b, SsimBorder::kZero), 1e-9);
    }
    EXPECT_NEAR(ssim(noise(11, 11, 1), noise(11, 11, 2), SsimBorder::kValid),
                brute_force_ssim(noise(11, 11, 1), noise(11, 11, 2), SsimBorder::kValid), 1e-9);
}

TEST(Ssim, NamesOfBorders) {
    EXPECT_EQ(parse_ssim_border("zero"), SsimBorder::kZero);
    EXPECT_THROW(parse_ssim_border("mirror"), UsageError);
}

TEST(Quantize, RendersAreClampedRoundedAndInterleaved) {
    RenderedImage render{2, 1, {-0.5f, 0.5f, 0.1f, 1.5f, std::nanf(""), 127.49f / 255}, {1, 1}};
    const Image image = quantized_render(render);
    ASSERT_EQ(image.channels, 3);
    // Planar (3,1,2): red -0.5, 0.5; green 0.1, 1.5; blue NaN, 127.49/255.
    EXPECT_EQ(image.u8, (std::vector<std::uint8_t>{0, 26, 0, 128, 255, 127}));
}

TEST(Quantize, TargetsAreCompositedOnTheBackground) {
    Image rgba{2, 1, 4, {255, 0, 51, 51, 10, 20, 30, 255}, {}};
    // Alpha 0.2 on (0.5, 1, 0): 0.2 + 0.4 = 0.6; 0.8; 0.04.
    EXPECT_EQ(quantized_target(rgba, {0.5f, 1, 0}).u8, (std::vector<std::uint8_t>{153, 204, 10, 10, 20, 30}));
    Image rgb{1, 1, 3, {1, 2, 3}, {}};
    EXPECT_EQ(quantized_target(rgb, {1, 1, 1}).u8, rgb.u8);
    Image hdr{1, 1, 3, {}, {2, 0.5f, -1}};
    EXPECT_EQ(quantized_target(hdr, {0, 0, 0}).u8, (std::vector<std::uint8_t>{255, 128, 0}));
}

}  // namespace
}  // namespace gs
