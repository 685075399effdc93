// SPDX-License-Identifier: Apache-2.0
// The controller against its definition layer by layer, and its gradient against finite differences.
#include "kernels/ppisp/ppisp.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "kernels/base/parallel.h"

namespace gs {
namespace {

template <class Real = double> std::vector<Real> random_image(int width, int height, std::uint32_t seed) {
    std::mt19937 rng(seed);
    std::uniform_real_distribution<double> u(0, 1);
    std::vector<Real> image(3 * std::size_t(width) * height);
    for (Real& x : image) x = Real(u(rng));
    return image;
}

template <class Real = double> std::vector<Real> random_controller(std::uint64_t seed) {
    PpispState state = identity_ppisp(1, 1);
    initialize_controller(state, seed);
    return {state.controller.begin(), state.controller.end()};
}

/// Computes docs/math/ppisp.md#controller as it stands there: every layer on the whole image, the 64 channels before
/// the mean.
std::vector<double> by_definition(const std::vector<double>& weights, const std::vector<double>& image, int w, int h,
                                  double prior) {
    std::size_t at = 0;
    const auto layer = [&](const std::vector<double>& in, int inputs, int outputs, std::size_t offset) {
        std::vector<double> out(outputs);
        for (int o = 0; o < outputs; ++o) {
            out[o] = weights[offset + std::size_t(inputs) * outputs + o];
            for (int i = 0; i < inputs; ++i) out[o] += weights[offset + std::size_t(o) * inputs + i] * in[i];
        }
        return out;
    };
    const auto relu = [](std::vector<double> x) {
        for (double& v : x) v = std::max(v, 0.0);
        return x;
    };
    const int pw = w / 3, ph = h / 3;
    std::vector<std::vector<double>> map(std::size_t(pw) * ph);
    for (int y = 0; y < ph; ++y)
        for (int x = 0; x < pw; ++x) {
            std::vector<double> pooled(16, -1e300);
            for (int p = 0; p < 9; ++p) {
                const std::size_t pixel = std::size_t(3 * y + p / 3) * w + 3 * x + p % 3, plane = std::size_t(w) * h;
                const auto value = layer({image[pixel], image[plane + pixel], image[2 * plane + pixel]}, 3, 16, 0);
                for (int c = 0; c < 16; ++c) pooled[c] = std::max(pooled[c], value[c]);
            }
            const auto second = relu(layer(relu(pooled), 16, 32, 64));
            map[y * pw + x] = layer(second, 32, 64, 64 + 544);
        }
    // torch.nn.AdaptiveAvgPool2d.
    std::vector<double> flat(1601);
    for (int by = 0; by < 5; ++by)
        for (int bx = 0; bx < 5; ++bx) {
            const int y0 = int(std::floor(by * ph / 5.0)), y1 = int(std::ceil((by + 1) * ph / 5.0)),
                      x0 = int(std::floor(bx * pw / 5.0)), x1 = int(std::ceil((bx + 1) * pw / 5.0));
            for (int c = 0; c < 64; ++c) {
                double sum = 0;
                for (int y = y0; y < y1; ++y)
                    for (int x = x0; x < x1; ++x) sum += map[y * pw + x][c];
                flat[c * 25 + by * 5 + bx] = sum / ((y1 - y0) * (x1 - x0));
            }
        }
    flat[1600] = prior;
    at = 64 + 544 + 2112;
    auto x = relu(layer(flat, 1601, 128, at));
    at += 1602 * 128;
    x = relu(layer(x, 128, 128, at));
    at += 129 * 128;
    x = relu(layer(x, 128, 128, at));
    at += 129 * 128;
    return layer(x, 128, 9, at);
}

TEST(Controller, EqualsTheDefinition) {
    for (const auto& [w, h] : {std::pair{20, 17}, {16, 9}, {3, 3}, {47, 4}, {45, 45}, {31, 64}}) {
        const auto weights = random_controller(w), image = random_image(w, h, h);
        Controller<double> controller;
        std::vector<double> out(9);
        controller.forward(weights.data(), image.data(), w, h, 0.7, out.data());
        const auto want = by_definition(weights, image, w, h, 0.7);
        for (int k = 0; k < 9; ++k) EXPECT_NEAR(out[k], want[k], 1e-13) << w << "x" << h << " " << k;
    }
}

TEST(Controller, BinsAreThoseOfAdaptivePooling) {
    for (int n = 1; n < 2000; ++n)
        for (int bin = 0; bin < 5; ++bin) {
            EXPECT_EQ(controller_bin_begin(bin, n), int(std::floor(bin * n / 5.0)));
            EXPECT_EQ(controller_bin_end(bin, n), int(std::ceil((bin + 1) * n / 5.0)));
        }
}

TEST(Controller, GradientMatchesFiniteDifferences) {
    std::mt19937 rng(3);
    for (const auto& [w, h] : {std::pair{20, 17}, {16, 9}, {3, 5}}) {
        auto weights = random_controller(7);
        const auto image = random_image(w, h, 4);
        const double dL_dout[9] = {1, -0.5, 0.3, 0.8, -1.2, 0.4, 0.6, -0.7, 0.9};
        Controller<double> controller;
        std::vector<double> out(9), gradient(kControllerWeights);
        const auto loss = [&] {
            controller.forward(weights.data(), image.data(), w, h, 0.3, out.data());
            double sum = 0;
            for (int k = 0; k < 9; ++k) sum += dL_dout[k] * out[k];
            return sum;
        };
        loss();
        controller.backward(weights.data(), image.data(), dL_dout, gradient.data());
        double worst = 0;
        for (int k = 0; k < kControllerLayers; ++k) {
            const ControllerLayer layer = controller_layer(k);
            const int begin = layer.offset, end = layer.bias() + layer.outputs;
            double scale = 0;
            for (int i = begin; i < end; ++i) scale = std::max(scale, std::abs(gradient[i]));
            EXPECT_GT(scale, 0);
            for (int sample = 0; sample < 120; ++sample) {
                const int i = sample < 20 ? end - 1 - sample % layer.outputs
                                          : begin + int(rng() % std::uint32_t(end - begin));  // biases, too
                double error = 1e9;
                for (const double step :
                     {1e-5, 1e-6, 1e-7}) {  // a unit or a maximum that switches in between is a kink
                    const double x = weights[i];
                    weights[i] = x + step;
                    const double up = loss();
                    weights[i] = x - step;
                    const double down = loss();
                    weights[i] = x;
                    error = std::min(error, std::abs((up - down) / (2 * step) - gradient[i]) /
                                                std::max(std::abs(gradient[i]), 1e-2 * scale));
                    if (error <= 1e-6) break;
                }
                EXPECT_LE(error, 1e-6) << "layer " << k << " weight " << i - begin;
                worst = std::max(worst, error);
            }
        }
        RecordProperty("worst_relative_error", std::to_string(worst));
    }
}

TEST(Controller, ImageWithoutABlockGivesZeros) {
    const auto weights = random_controller(1);
    for (const auto& [w, h] : {std::pair{2, 100}, {100, 2}, {1, 1}}) {
        const auto image = random_image(w, h, 1);
        Controller<double> controller;
        std::vector<double> out(9, 1), gradient(kControllerWeights, 1);
        controller.forward(weights.data(), image.data(), w, h, 1, out.data());
        controller.backward(weights.data(), image.data(), out.data(), gradient.data());
        for (const double x : out) EXPECT_EQ(x, 0);
        for (const double x : gradient) EXPECT_EQ(x, 0);
    }
}

TEST(Controller, IsIndependentOfTheNumberOfThreads) {
    const auto weights = random_controller<float>(2);
    const int w = 200, h = 131;
    const auto image = random_image<float>(w, h, 5);
    std::vector<float> out[2], gradient[2];
    for (int k = 0; k < 2; ++k) {
        set_num_threads(k ? 3 : 1);
        Controller<float> controller;
        out[k].resize(9), gradient[k].resize(kControllerWeights);
        controller.forward(weights.data(), image.data(), w, h, 0, out[k].data());
        controller.backward(weights.data(), image.data(), out[k].data(), gradient[k].data());
    }
    set_num_threads(0);
    EXPECT_EQ(out[0], out[1]);
    EXPECT_EQ(gradient[0], gradient[1]);
}

TEST(Controller, WeightsStartWithinTheirBounds) {
    PpispState state = identity_ppisp(3, 2);
    initialize_controller(state, 11);
    ASSERT_EQ(state.controller.size(), 2u * kControllerWeights);
    for (int k = 0; k < kControllerLayers; ++k) {
        const ControllerLayer layer = controller_layer(k);
        const double bound = 1 / std::sqrt(double(layer.inputs));
        double largest = 0, sum = 0;
        const int n = layer.bias() + layer.outputs - layer.offset;
        for (int i = 0; i < n; ++i)
            largest = std::max(largest, double(std::abs(state.controller[layer.offset + i]))),
            sum += state.controller[layer.offset + i];
        EXPECT_LE(largest, bound * 1.000001);
        EXPECT_GT(largest, 0.9 * bound);
        EXPECT_NEAR(sum / n, 0, 4 * bound / std::sqrt(3.0 * n)) << k;
    }
    EXPECT_NE(state.controller[0], state.controller[kControllerWeights]) << "cameras differ";
}

}  // namespace
}  // namespace gs
