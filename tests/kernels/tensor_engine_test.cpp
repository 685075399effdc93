// SPDX-License-Identifier: Apache-2.0
// The engine of the CPU against hand-checked values and plain loops in double. tests/gpu compares the GPU's with it.
#include "kernels/tensors/tensor_engine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "tests/kernels/random_tensors.h"

namespace gs {
namespace {

using test::random_layer;
using test::random_tensor;

const TensorEngine& engine() {
    static const std::unique_ptr<TensorEngine> cpu = make_cpu_tensor_engine();
    return *cpu;
}

Tensor tensor_of(int height, int width, const std::vector<float>& values) {
    return engine().upload(int(values.size()) / (height * width), height, width, values);
}
std::vector<float> values_of(const Tensor& tensor) { return engine().download(tensor); }

/// The value at (c, y, x), 0 outside.
double at(const Tensor& t, int c, int y, int x) {
    return y < 0 || x < 0 || y >= t.height || x >= t.width
               ? 0.0
               : double(t.values[std::size_t(c) * t.pixels() + std::size_t(y) * t.width + x]);
}

/// A layer of the given weights and biases.
ConvLayer layer_of(ConvLayer layer, const std::vector<float>& weights, const std::vector<float>& bias) {
    layer.weights = engine().upload(layer.out, layer.in, layer.kernel * layer.kernel, weights);
    layer.bias = engine().upload(layer.out, 1, 1, bias);
    return layer;
}

TEST(Convolution, TwoLayersByHand) {
    const Tensor in = tensor_of(3, 3, {1, 2, 3, 4, 5, 6, 7, 8, 9});
    // Diagonal minus antidiagonal of each 2x2 window is 0 everywhere; the sum of the window's upper row is not.
    const ConvLayer first = layer_of({1, 2, 2, 1, 0}, {1, -1, -1, 1, 1, 1, 0, 0}, {0.5f, -4});
    const Tensor middle = engine().convolve(in, first, true);
    EXPECT_EQ(values_of(middle), (std::vector<float>{0.5f, 0.5f, 0.5f, 0.5f, 0, 1, 5, 7}));
    // Stride 2 with a border of zeros leaves one window for each corner of the padded map.
    const ConvLayer second = layer_of({2, 1, 2, 2, 1}, {1, 2, 3, 4, -1, 0, 0, 1}, {-3});
    const Tensor out = engine().convolve(middle, second, false);
    ASSERT_EQ(out.height, 2);
    EXPECT_EQ(values_of(out), (std::vector<float>{-3 + 2 + 0, -3 + 1.5f + 0, -3 + 1 + 0, -3 + 0.5f - 7}));
    EXPECT_EQ(values_of(engine().convolve(middle, second, true)), (std::vector<float>{0, 0, 0, 0}));
}

TEST(Convolution, EqualsPlainLoops) {
    struct Case {
        int in, out, kernel, stride, padding, height, width;
    };
    // Sizes with several blocks of pixels, blocks that end within a row, and windows wider than the map.
    for (const Case& c : {Case{3, 5, 3, 1, 1, 71, 67},
                          {7, 4, 1, 1, 0, 40, 33},
                          {2, 3, 11, 4, 2, 63, 90},
                          {4, 6, 5, 1, 2, 3, 2},
                          {2, 2, 3, 2, 0, 9, 10},
                          {150, 8, 3, 1, 1, 33, 35},
                          {1, 1, 3, 1, 1, 1, 1}}) {
        const Tensor in = random_tensor(engine(), c.in, c.height, c.width, 1);
        const ConvLayer layer = random_layer(engine(), {c.in, c.out, c.kernel, c.stride, c.padding}, 2);
        const Tensor plain = engine().convolve(in, layer, false), rectified = engine().convolve(in, layer, true);
        ASSERT_EQ(plain.height, (c.height + 2 * c.padding - c.kernel) / c.stride + 1);
        ASSERT_EQ(plain.width, (c.width + 2 * c.padding - c.kernel) / c.stride + 1);
        double worst = 0;
        for (int o = 0; o < c.out; ++o) {
            for (int y = 0; y < plain.height; ++y) {
                for (int x = 0; x < plain.width; ++x) {
                    double sum = layer.bias.values[o], size = 1;
                    for (int i = 0; i < c.in; ++i) {
                        for (int ky = 0; ky < c.kernel; ++ky) {
                            for (int kx = 0; kx < c.kernel; ++kx) {
                                const double term =
                                    double(layer.weights
                                               .values[((std::size_t(o) * c.in + i) * c.kernel + ky) * c.kernel + kx]) *
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
        EXPECT_LT(worst, 1e-6) << c.in << " -> " << c.out << ", kernel " << c.kernel << ", " << c.width << "x"
                               << c.height;
    }
}

TEST(TensorEngine, TheNumberOfThreadsChangesNoBit) {
    const Tensor in = random_tensor(engine(), 16, 150, 61, 4), other = random_tensor(engine(), 16, 150, 61, 5),
                 heads = random_tensor(engine(), 16, 1, 1, 6);
    const ConvLayer layer = random_layer(engine(), {16, 24, 3, 1, 1}, 7);
    const auto numbers = [&] {
        std::vector<double> all = {engine().direction_distance(in, other, heads),
                                   engine().compare_channels(in, other)[7].difference};
        for (const float v : values_of(engine().convolve(in, layer, true))) all.push_back(v);
        return all;
    };
    const int threads = num_threads();
    set_num_threads(1);
    const auto one = numbers();
    set_num_threads(3);
    EXPECT_EQ(numbers(), one);
    set_num_threads(threads);
}

TEST(TensorEngine, WhatDoesNotFitIsRefused) {
    const auto zeros = [](int channels, int height, int width) {
        return engine().upload(channels, height, width, std::vector<float>(std::size_t(channels) * height * width));
    };
    const ConvLayer layer = layer_of({2, 1, 3, 1, 0}, std::vector<float>(18), {0});
    EXPECT_THROW(engine().convolve(zeros(3, 5, 5), layer, false), UsageError);
    EXPECT_THROW(engine().convolve(zeros(2, 2, 5), layer, false), UsageError);
    ConvLayer other = layer;
    other.kernel = 2;
    EXPECT_THROW(engine().convolve(zeros(2, 5, 5), other, false), UsageError) << "weights of another window";
    EXPECT_THROW(engine().max_pool(zeros(1, 2, 9), 3, 2), UsageError);
    EXPECT_THROW(engine().average_pool(zeros(1, 1, 4)), UsageError);
    EXPECT_THROW(engine().stacked({zeros(1, 2, 2), zeros(1, 2, 3)}), UsageError);
    EXPECT_THROW(engine().compare_channels(zeros(1, 2, 2), zeros(2, 2, 2)), UsageError);
    EXPECT_THROW(engine().direction_distance(zeros(2, 2, 2), zeros(2, 2, 2), zeros(1, 1, 1)), UsageError);
    EXPECT_THROW(engine().masked_difference(zeros(2, 2, 2), zeros(2, 2, 2), zeros(2, 2, 2)), UsageError);
}

TEST(Pooling, LargestAndMeanDropWhatIsLeftOver) {
    const Tensor in = random_tensor(engine(), 3, 11, 14, 7);
    for (const auto& [size, stride] : {std::pair(2, 2), {3, 2}}) {
        const Tensor out = engine().max_pool(in, size, stride);
        ASSERT_EQ(out.height, (11 - size) / stride + 1);
        ASSERT_EQ(out.width, (14 - size) / stride + 1);
        for (int c = 0; c < 3; ++c) {
            for (int y = 0; y < out.height; ++y) {
                for (int x = 0; x < out.width; ++x) {
                    double largest = -9;
                    for (int i = 0; i < size * size; ++i)
                        largest = std::max(largest, at(in, c, y * stride + i / size, x * stride + i % size));
                    EXPECT_EQ(at(out, c, y, x), largest);
                }
            }
        }
    }
    const Tensor mean = engine().average_pool(in);
    ASSERT_EQ(mean.height, 5);
    ASSERT_EQ(mean.width, 7);
    for (int y = 0; y < 5; ++y) {
        for (int x = 0; x < 7; ++x) {
            const double expected = (at(in, 2, 2 * y, 2 * x) + at(in, 2, 2 * y, 2 * x + 1) +
                                     at(in, 2, 2 * y + 1, 2 * x) + at(in, 2, 2 * y + 1, 2 * x + 1)) /
                                    4;
            EXPECT_NEAR(at(mean, 2, y, x), expected, 1e-6);
        }
    }
}

TEST(Pooling, L2IsTheRootOfTheHanningMeanOfSquares) {
    for (const auto& [height, width] : {std::pair(7, 10), {1, 1}, {4, 3}}) {
        const Tensor in = random_tensor(engine(), 2, height, width, 8), out = engine().l2_pool(in);
        ASSERT_EQ(out.height, (height + 1) / 2);
        ASSERT_EQ(out.width, (width + 1) / 2);
        double total = 0;
        for (int j = 1; j <= 3; ++j)
            total += std::pow(std::sin(M_PI * j / 4), 2);  // Hanning window of 5 without its zeros
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
    EXPECT_FLOAT_EQ(values_of(engine().l2_pool(tensor_of(2, 2, {0, 0, 0, 0})))[0], 1e-6f);
}

TEST(Upsampling, CornersStayAndTheLastRowIsRepeated) {
    const auto expect_near = [](const Tensor& tensor, const std::vector<float>& expected) {
        const std::vector<float> values = values_of(tensor);
        ASSERT_EQ(values.size(), expected.size());
        for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(values[i], expected[i], 1e-5) << i;
    };
    expect_near(engine().upsample_aligned(tensor_of(1, 2, {0, 3}), 2, 5), {0, 1, 2, 3, 3, 0, 1, 2, 3, 3});
    expect_near(engine().upsample_aligned(tensor_of(2, 2, {0, 3, 9, 12}), 5, 4),
                {0, 1, 2, 3, 3, 4, 5, 6, 6, 7, 8, 9, 9, 10, 11, 12, 9, 10, 11, 12});
}

TEST(Sums, ByHand) {
    const Tensor a = tensor_of(1, 2, {3, 0, 4, 0}),
                 b = tensor_of(1, 2, {0, 0, 2, 5});  // pixels (3,4) and (0,0); (0,2) and (0,5)
    EXPECT_EQ(values_of(engine().stacked({a, b})), (std::vector<float>{3, 0, 4, 0, 0, 0, 2, 5}));
    // Directions (0.6,0.8) and none; (0,1) twice.
    EXPECT_NEAR(engine().direction_distance(a, b, tensor_of(1, 1, {2, 10})), (2 * 0.36 + 10 * 0.04 + 10 * 1) / 2, 1e-8);
    const ChannelComparison c = engine().compare_channels(a, b)[1];
    EXPECT_EQ(c.mean_a, 2);
    EXPECT_EQ(c.mean_b, 3.5);
    EXPECT_EQ(c.variance_a, 4);
    EXPECT_EQ(c.variance_b, 2.25);
    EXPECT_EQ(c.difference, 12.25);
    EXPECT_EQ(engine().masked_difference(tensor_of(1, 2, {1, 2}), a, b), (1 * (3 + 2) + 2 * 5) / 4.0);
    EXPECT_EQ(values_of(engine().add_logistic(tensor_of(1, 2, {0, -100}), tensor_of(1, 2, {3, 4}))),
              (std::vector<float>{3.5f, 4}));
}

}  // namespace
}  // namespace gs
