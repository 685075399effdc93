// SPDX-License-Identifier: Apache-2.0
// The engine on the device against the CPU's. Skipped where there is no device.
#include "kernels/tensors/tensor_engine.h"

#include <cmath>

#include "kernels/base/error.h"
#include "tests/gpu/gpu_test.h"
#include "tests/kernels/random_tensors.h"

namespace gs::test {
namespace {

/// Error of one value, relative to the sum of the magnitudes that it is made of. Both engines add up to 3^2 * 512
/// products one after another or in blocks; the error grows with the square root of their number.
constexpr double kTolerance = 1e-5;

class GpuTensors : public Gpu {
  protected:
    void SetUp() override {
        Gpu::SetUp();
        if (!IsSkipped()) gpu_ = make_cuda_tensor_engine();
    }

    /// Calls make(engine) for both engines and compares the results. Errors are relative to `scale` of each value, or
    /// to its magnitude (at least 1) where there is no scale.
    template <class Make> void expect_same(const char* what, Make make, const std::vector<float>& scale = {}) {
        const Tensor a = make(*cpu_), b = make(*gpu_);
        ASSERT_EQ(a.channels, b.channels) << what;
        ASSERT_EQ(a.height, b.height) << what;
        ASSERT_EQ(a.width, b.width) << what;
        const std::vector<float> expected = cpu_->download(a), values = gpu_->download(b);
        ASSERT_EQ(values.size(), expected.size()) << what;
        double worst = 0;
        for (std::size_t i = 0; i < values.size(); ++i) {
            const double error = std::abs(double(values[i]) - expected[i]) /
                                 (scale.empty() ? std::max(1.0f, std::abs(expected[i])) : scale[i]);
            if (!(error <= worst)) worst = error;
        }
        std::printf("  %-60s worst relative difference %.1e\n", what, worst);
        EXPECT_LE(worst, kTolerance) << what;
    }
    void expect_near(const char* what, double value, double expected) {
        std::printf("  %-60s %.9g, relative difference %.1e\n", what, value,
                    std::abs(value - expected) / std::abs(expected));
        EXPECT_LE(std::abs(value - expected), kTolerance * std::abs(expected)) << what;
    }

    std::unique_ptr<TensorEngine> cpu_ = make_cpu_tensor_engine(), gpu_;
};

/// Returns the magnitudes of a tensor of the CPU.
Tensor magnitude(const TensorEngine& engine, const Tensor& t) {
    std::vector<float> values = engine.download(t);
    for (float& v : values) v = std::abs(v);
    return engine.upload(t.channels, t.height, t.width, values);
}

TEST_F(GpuTensors, ConvolutionsAreTheOnesOfTheCpu) {
    struct Case {
        int in, out, kernel, stride, padding, height, width;
    };
    // Images of one pixel, windows wider than the image, tiles (64 channels, 128 pixels, 8 of the depth) that are full
    // and that are not, and the layers of AlexNet, VGG16 and MILO.
    for (const Case& c : {Case{1, 1, 1, 1, 0, 1, 1},
                          {1, 1, 3, 1, 1, 1, 1},
                          {5, 3, 3, 1, 1, 1, 7},
                          {4, 6, 5, 1, 2, 3, 2},
                          {2, 2, 3, 2, 0, 9, 10},
                          {8, 64, 1, 1, 0, 8, 16},
                          {9, 65, 1, 1, 0, 3, 43},
                          {7, 63, 3, 1, 1, 17, 15},
                          {3, 64, 11, 4, 2, 63, 91},
                          {64, 192, 5, 1, 2, 15, 22},
                          {192, 384, 3, 1, 1, 7, 10},
                          {3, 64, 3, 1, 1, 61, 67},
                          {512, 512, 3, 1, 1, 5, 9},
                          {7, 32, 3, 1, 1, 33, 40},
                          {16, 1, 3, 1, 1, 33, 40}}) {
        const ConvLayer shape{c.in, c.out, c.kernel, c.stride, c.padding};
        const std::string name = std::to_string(c.in) + " -> " + std::to_string(c.out) + ", kernel " +
                                 std::to_string(c.kernel) + ", stride " + std::to_string(c.stride) + ", " +
                                 std::to_string(c.width) + "x" + std::to_string(c.height);
        ConvLayer magnitudes = random_layer(*cpu_, shape, 2);
        magnitudes.weights = magnitude(*cpu_, magnitudes.weights), magnitudes.bias = magnitude(*cpu_, magnitudes.bias);
        const auto scale = cpu_->download(
            cpu_->convolve(magnitude(*cpu_, random_tensor(*cpu_, c.in, c.height, c.width, 1)), magnitudes, false));
        for (const bool relu : {false, true})
            expect_same((name + (relu ? ", rectified" : "")).c_str(),
                        [&](const TensorEngine& e) {
                            return e.convolve(random_tensor(e, c.in, c.height, c.width, 1), random_layer(e, shape, 2),
                                              relu);
                        },
                        scale);
    }
}

TEST_F(GpuTensors, PoolingAndUpsamplingAreTheOnesOfTheCpu) {
    for (const auto& [height, width] : {std::pair(1, 1), {2, 3}, {3, 3}, {17, 300}, {64, 33}}) {
        SCOPED_TRACE(std::to_string(width) + "x" + std::to_string(height));
        const auto in = [&](const TensorEngine& e) { return random_tensor(e, 5, height, width, 3); };
        expect_same("l2_pool", [&](const TensorEngine& e) { return e.l2_pool(in(e)); });
        expect_same("upsample_aligned",
                    [&](const TensorEngine& e) { return e.upsample_aligned(in(e), 2 * height + 1, 2 * width); });
        expect_same("add_logistic", [&](const TensorEngine& e) {
            return e.add_logistic(in(e), random_tensor(e, 5, height, width, 4));
        });
        expect_same("stacked", [&](const TensorEngine& e) {
            return e.stacked({in(e), random_tensor(e, 1, height, width, 5), in(e)});
        });
        if (height < 2) continue;
        expect_same("average_pool", [&](const TensorEngine& e) { return e.average_pool(in(e)); });
        expect_same("max_pool 2", [&](const TensorEngine& e) { return e.max_pool(in(e), 2, 2); });
        if (height < 3) continue;
        expect_same("max_pool 3", [&](const TensorEngine& e) { return e.max_pool(in(e), 3, 2); });
    }
}

TEST_F(GpuTensors, SumsAreTheOnesOfTheCpu) {
    for (const auto& [channels, height, width] : {std::tuple(2, 1, 1), {3, 17, 15}, {67, 16, 16}, {5, 123, 211}}) {
        const auto a = [&, c = channels, h = height, w = width](const TensorEngine& e) {
            return random_tensor(e, c, h, w, 6);
        };
        const auto b = [&, c = channels, h = height, w = width](const TensorEngine& e) {
            return random_tensor(e, c, h, w, 7);
        };
        const auto direction = [&, c = channels](const TensorEngine& e) {
            return e.direction_distance(a(e), b(e), random_tensor(e, c, 1, 1, 9));
        };
        const auto masked = [&, h = height, w = width](const TensorEngine& e) {
            return e.masked_difference(magnitude(e, random_tensor(e, 1, h, w, 8)), a(e), b(e));
        };
        expect_near("direction_distance", direction(*gpu_), direction(*cpu_));
        expect_near("masked_difference", masked(*gpu_), masked(*cpu_));
        const auto expected = cpu_->compare_channels(a(*cpu_), b(*cpu_)),
                   values = gpu_->compare_channels(a(*gpu_), b(*gpu_));
        ASSERT_EQ(values.size(), expected.size());
        for (std::size_t c = 0; c < values.size(); ++c) {
            EXPECT_NEAR(values[c].mean_a, expected[c].mean_a, 1e-12);
            EXPECT_NEAR(values[c].mean_b, expected[c].mean_b, 1e-12);
            EXPECT_NEAR(values[c].variance_a, expected[c].variance_a, 1e-12);
            EXPECT_NEAR(values[c].variance_b, expected[c].variance_b, 1e-12);
            EXPECT_NEAR(values[c].difference, expected[c].difference, 1e-12);
        }
        EXPECT_EQ(gpu_->direction_distance(a(*gpu_), a(*gpu_), random_tensor(*gpu_, channels, 1, 1, 9)), 0)
            << "equal maps";
        EXPECT_EQ(direction(*gpu_), direction(*gpu_)) << "the same bits again";
    }
}

TEST_F(GpuTensors, WhatDoesNotFitIsRefused) {
    EXPECT_THROW(gpu_->max_pool(random_tensor(*gpu_, 1, 2, 9, 1), 3, 2), UsageError);
    EXPECT_THROW(gpu_->convolve(random_tensor(*gpu_, 3, 5, 5, 1), random_layer(*gpu_, {2, 1, 3, 1, 0}, 1), false),
                 UsageError);
}

}  // namespace
}  // namespace gs::test
