// SPDX-License-Identifier: Apache-2.0
// The convolution engine against hand-checked values and plain loops in double.
#include "eval/convolution.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "kernels/core/error.h"
#include "kernels/core/parallel.h"
#include "tests/eval/random_weights.h"

namespace gs {
namespace {

FeatureMap random_map(int channels, int height, int width, std::uint64_t seed) {
    FeatureMap map(channels, height, width);
    map.values = test::random_values(map.values.size(), seed, -1, 1);
    return map;
}

FeatureMap map_of(int height, int width, std::vector<float> values) {
    FeatureMap map(int(values.size()) / (height * width), height, width);
    map.values = std::move(values);
    return map;
}

/// The value at (c, y, x), 0 outside.
double at(const FeatureMap& map, int c, int y, int x) {
    return y < 0 || x < 0 || y >= map.height || x >= map.width ? 0.0 : double(map.plane(c)[y * map.width + x]);
}

TEST(Convolution, TwoLayersByHand) {
    const FeatureMap in = map_of(3, 3, {1, 2, 3, 4, 5, 6, 7, 8, 9});
    // Diagonal minus antidiagonal of each 2x2 window is 0 everywhere; the sum of the window's upper row is not.
    const ConvLayer first{1, 2, 2, 1, 0, {1, -1, -1, 1, 1, 1, 0, 0}, {0.5f, -4}};
    const FeatureMap middle = convolve(in, first, true);
    EXPECT_EQ(middle.values, (std::vector<float>{0.5f, 0.5f, 0.5f, 0.5f, 0, 1, 5, 7}));
    // Stride 2 with a border of zeros leaves one window for each corner of the padded map.
    const ConvLayer second{2, 1, 2, 2, 1, {1, 2, 3, 4, -1, 0, 0, 1}, {-3}};
    const FeatureMap out = convolve(middle, second, false);
    ASSERT_EQ(out.height, 2);
    EXPECT_EQ(out.values, (std::vector<float>{-3 + 2 + 0, -3 + 1.5f + 0, -3 + 1 + 0, -3 + 0.5f - 7}));
    EXPECT_EQ(convolve(middle, second, true).values, (std::vector<float>{0, 0, 0, 0}));
}

TEST(Convolution, EqualsPlainLoops) {
    struct Case {
        int in, out, kernel, stride, padding, height, width;
    };
    // Sizes with several blocks of pixels, blocks that end within a row, and windows wider than the map.
    for (const Case& c : {Case{3, 5, 3, 1, 1, 71, 67}, {7, 4, 1, 1, 0, 40, 33}, {2, 3, 11, 4, 2, 63, 90}, {4, 6, 5, 1, 2, 3, 2},
                          {2, 2, 3, 2, 0, 9, 10}, {150, 8, 3, 1, 1, 33, 35}, {1, 1, 3, 1, 1, 1, 1}}) {
        const FeatureMap in = random_map(c.in, c.height, c.width, 1);
        const std::size_t weights = std::size_t(c.out) * c.in * c.kernel * c.kernel;
        const ConvLayer layer{c.in, c.out, c.kernel, c.stride, c.padding, test::random_values(weights, 2, -1, 1), test::random_values(c.out, 3, -1, 1)};
        const FeatureMap plain = convolve(in, layer, false), rectified = convolve(in, layer, true);
        ASSERT_EQ(plain.height, (c.height + 2 * c.padding - c.kernel) / c.stride + 1);
        ASSERT_EQ(plain.width, (c.width + 2 * c.padding - c.kernel) / c.stride + 1);
        double worst = 0;
        for (int o = 0; o < c.out; ++o) {
            for (int y = 0; y < plain.height; ++y) {
                for (int x = 0; x < plain.width; ++x) {
                    double sum = layer.bias[o], size = 1;
                    for (int i = 0; i < c.in; ++i) {
                        for (int ky = 0; ky < c.kernel; ++ky) {
                            for (int kx = 0; kx < c.kernel; ++kx) {
                                const double term = double(layer.weights[((std::size_t(o) * c.in + i) * c.kernel + ky) * c.kernel + kx]) *
                                                    at(in, i, y * c.stride - c.padding + ky, x * c.stride - c.padding + kx);
                                sum += term;
                                size += std::abs(term);
                            }
                        }
                    }
                    worst = std::max(worst, std::abs(at(plain, o, y, x) - sum) / size);
                    worst = std::max(worst, std::abs(at(rectified, o, y, x) - std::max(sum, 0.0)) / size);
                }
            }
        }
        EXPECT_LT(worst, 1e-6) << c.in << " -> " << c.out << ", kernel " << c.kernel << ", " << c.width << "x" << c.height;
    }
}

TEST(Convolution, TheNumberOfThreadsChangesNoBit) {
    const FeatureMap in = random_map(16, 50, 61, 4);
    const ConvLayer layer{16, 24, 3, 1, 1, test::random_values(24 * 16 * 9, 5, -1, 1), test::random_values(24, 6, -1, 1)};
    const int threads = num_threads();
    set_num_threads(1);
    const FeatureMap one = convolve(in, layer, true);
    set_num_threads(3);
    const FeatureMap three = convolve(in, layer, true);
    set_num_threads(threads);
    EXPECT_EQ(one.values, three.values);
}

TEST(Convolution, WhatDoesNotFitIsRefused) {
    const ConvLayer layer{2, 1, 3, 1, 0, std::vector<float>(18), {0}};
    EXPECT_THROW(convolve(FeatureMap(3, 5, 5), layer, false), UsageError);
    EXPECT_THROW(convolve(FeatureMap(2, 2, 5), layer, false), UsageError);
    EXPECT_THROW(max_pool(FeatureMap(1, 2, 9), 3, 2), UsageError);
    EXPECT_THROW(average_pool(FeatureMap(1, 1, 4)), UsageError);
}

TEST(Pooling, LargestAndMeanDropWhatIsLeftOver) {
    const FeatureMap in = random_map(3, 11, 14, 7);
    for (const auto& [size, stride] : {std::pair(2, 2), {3, 2}}) {
        const FeatureMap out = max_pool(in, size, stride);
        ASSERT_EQ(out.height, (11 - size) / stride + 1);
        ASSERT_EQ(out.width, (14 - size) / stride + 1);
        for (int c = 0; c < 3; ++c) {
            for (int y = 0; y < out.height; ++y) {
                for (int x = 0; x < out.width; ++x) {
                    double largest = -9;
                    for (int i = 0; i < size * size; ++i) largest = std::max(largest, at(in, c, y * stride + i / size, x * stride + i % size));
                    EXPECT_EQ(at(out, c, y, x), largest);
                }
            }
        }
    }
    const FeatureMap mean = average_pool(in);
    ASSERT_EQ(mean.height, 5);
    ASSERT_EQ(mean.width, 7);
    for (int y = 0; y < 5; ++y) {
        for (int x = 0; x < 7; ++x) {
            const double expected = (at(in, 2, 2 * y, 2 * x) + at(in, 2, 2 * y, 2 * x + 1) + at(in, 2, 2 * y + 1, 2 * x) + at(in, 2, 2 * y + 1, 2 * x + 1)) / 4;
            EXPECT_NEAR(at(mean, 2, y, x), expected, 1e-6);
        }
    }
}

TEST(Pooling, L2IsTheRootOfTheHanningMeanOfSquares) {
    for (const auto& [height, width] : {std::pair(7, 10), {1, 1}, {4, 3}}) {
        const FeatureMap in = random_map(2, height, width, 8), out = l2_pool(in);
        ASSERT_EQ(out.height, (height + 1) / 2);
        ASSERT_EQ(out.width, (width + 1) / 2);
        double total = 0;
        for (int j = 1; j <= 3; ++j) total += std::pow(std::sin(M_PI * j / 4), 2);  // Hanning window of 5 without its zeros
        for (int c = 0; c < 2; ++c) {
            for (int y = 0; y < out.height; ++y) {
                for (int x = 0; x < out.width; ++x) {
                    double sum = 1e-12;
                    for (int j = 1; j <= 3; ++j) {
                        for (int i = 1; i <= 3; ++i) {
                            const double weight = std::pow(std::sin(M_PI * j / 4) * std::sin(M_PI * i / 4) / total, 2);
                            sum += weight * std::pow(at(in, c, 2 * y + j - 2, 2 * x + i - 2), 2);
                        }
                    }
                    EXPECT_NEAR(at(out, c, y, x), std::sqrt(sum), 1e-6);
                }
            }
        }
    }
    EXPECT_FLOAT_EQ(l2_pool(FeatureMap(1, 2, 2)).values[0], 1e-6f);
}

TEST(Upsampling, CornersStayAndTheLastRowIsRepeated) {
    const auto expect_near = [](const FeatureMap& map, const std::vector<float>& expected) {
        ASSERT_EQ(map.values.size(), expected.size());
        for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(map.values[i], expected[i], 1e-5) << i;
    };
    expect_near(upsample_aligned(map_of(1, 2, {0, 3}), 2, 5), {0, 1, 2, 3, 3, 0, 1, 2, 3, 3});
    expect_near(upsample_aligned(map_of(2, 2, {0, 3, 9, 12}), 5, 4), {0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9, 9, 10, 11, 12, 9, 10, 11, 12});
}

}  // namespace
}  // namespace gs
