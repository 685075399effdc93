// SPDX-License-Identifier: Apache-2.0
// Neural: golden vector, zeros at the start, vectors against scalars, the variants' sizes.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "appearance/model_info.h"
#include "appearance/neural/neural.h"

namespace gs {
namespace {

using appearance::Neural;

const Vec3<double> kDirection{0.2672612419124244, 0.5345224838248488, 0.8017837257372732};  // (1,2,3) normalised

/// The golden vector's network, whose matrices are given as (to, from).
std::vector<double> golden_weights() {
    std::vector<double> w(Neural::kNumShared);
    for (int i = 0; i < 16; ++i) {
        for (int j = 0; j < 32; ++j) w[j * 16 + i] = 0.3 * std::sin(0.1 * (32 * i + j));
        for (int j = 0; j < 16; ++j) w[Neural::matrix(1) + j * 16 + i] = 0.3 * std::cos(0.1 * (16 * i + j));
    }
    for (int c = 0; c < 3; ++c)
        for (int j = 0; j < 16; ++j) w[Neural::kFirstOutput + c * 16 + j] = 0.02 * std::sin(0.2 * (16 * c + j));
    return w;
}

TEST(Neural, GoldenVector) {
    const auto w = golden_weights();
    double f[8], df[8];
    for (int i = 0; i < 8; ++i) f[i] = 0.1 * (i + 1);
    const Vec3<double> a = Neural::residual(w.data(), f, kDirection, 3);
    EXPECT_NEAR(a.x, .364689048, 1e-9);
    EXPECT_NEAR(a.y, -.364954111, 1e-9);
    EXPECT_NEAR(a.z, .364087815, 1e-9);
    std::vector<double> dw(w.size());
    Vec3<double> dd;
    Neural::residual_backward(w.data(), f, kDirection, 3, {1, -.5, .25}, df, dd, dw.data());
    const double want[8] = {.0215981123, .0272492932, .0291822404,  .0275893609,
                            .0229871963, .0161665424, .00811801545, -6.02463354e-5};
    for (int i = 0; i < 8; ++i) EXPECT_NEAR(df[i], want[i], 1e-10) << i;
    const Vec3<double> g = direction_pullback(view_direction(Vec3<double>{1, 2, 3}, Vec3<double>{0, 0, 0}), dd);
    EXPECT_NEAR(g.x, -.00635713736, 1e-10);
    EXPECT_NEAR(g.y, -.0134246271, 1e-10);
    EXPECT_NEAR(g.z, .0110687972, 1e-10);
    const auto squared = [&](int from, int to) {
        double s = 0;
        for (int k = from; k < to; ++k) s += dw[k] * dw[k];
        return s;
    };
    EXPECT_NEAR(squared(0, 512), .0586112764, 1e-9);
    EXPECT_NEAR(squared(512, 768), .199762484, 1e-8);
    EXPECT_NEAR(squared(768, 816), 135.790136, 1e-5);
    const double first[3] = {.00263146981, .0262269239, .00523664685}, out[4] = {3.55776946, 0, 0, 3.66393596};
    for (int j = 0; j < 3; ++j) EXPECT_NEAR(dw[j * 16], first[j], 1e-10) << j;
    for (int j = 0; j < 4; ++j) EXPECT_NEAR(dw[Neural::kFirstOutput + j], out[j], 1e-7) << j;
}

TEST(Neural, AtTheStartOnlyTheOutputLearns) {
    std::vector<float> w(Neural::kNumShared), dw(w.size());
    appearance_model("neural").init_shared(7, w.data());
    const float f[8] = {};
    float df[8] = {};
    Vec3<float> dd;
    const Vec3<float> d{0.6f, 0, 0.8f};
    EXPECT_EQ(Neural::residual(w.data(), f, d, 3).x, 0);
    Neural::residual_backward(w.data(), f, d, 3, {1, 2, 3}, df, dd, dw.data());
    EXPECT_EQ(dot(dd, dd), 0);
    for (const float x : df) EXPECT_EQ(x, 0);
    for (int k = 0; k < Neural::kFirstOutput; ++k) EXPECT_EQ(dw[k], 0) << k;
    double sum = 0;
    for (int k = Neural::kFirstOutput; k < Neural::kNumShared; ++k) sum += std::abs(dw[k]);
    EXPECT_GT(sum, 0);
}

TEST(Neural, InitialWeightsAreUniformInGlorotsBounds) {
    std::vector<float> w(Neural::kNumShared), again(w.size()), other(w.size());
    const ModelInfo& info = appearance_model("neural");
    info.init_shared(7, w.data()), info.init_shared(7, again.data()), info.init_shared(8, other.data());
    EXPECT_EQ(w, again);
    EXPECT_NE(w, other);
    for (const auto& [from, to, bound] : {std::tuple{0, 512, 0.353553}, {512, 768, 0.433013}}) {
        double largest = 0, sum = 0, squares = 0;
        for (int k = from; k < to; ++k)
            largest = std::max(largest, std::abs(double(w[k]))), sum += w[k], squares += double(w[k]) * w[k];
        const double n = to - from, sigma = bound / std::sqrt(3.0);
        EXPECT_LE(largest, bound * 1.00001);
        EXPECT_GT(largest, 0.95 * bound);
        EXPECT_LT(std::abs(sum / n), 5 * sigma / std::sqrt(n));
        EXPECT_NEAR(std::sqrt(squares / n), sigma, 0.1 * sigma);
    }
}

TEST(Neural, VectorsEqualScalars) {
    // long double has no vector type and uses the scalar form of the network.
    std::mt19937 rng(3);
    std::normal_distribution<double> normal;
    std::vector<double> w(16 * 3);
    for (double& x : w) x = normal(rng);
    appearance::LaneNeurons<double, 16> a = appearance::LaneNeurons<double, 16>::zero();
    appearance::ScalarNeurons<double, 16> b = appearance::ScalarNeurons<double, 16>::zero();
    for (int j = 0; j < 3; ++j) a.add(w.data() + 16 * j, 0.3 * j - 0.2), b.add(w.data() + 16 * j, 0.3 * j - 0.2);
    EXPECT_NEAR(a.dot(w.data()), b.dot(w.data()), 1e-13);
    a.relu(), b.relu();
    for (int i = 0; i < 16; ++i) EXPECT_NEAR(a[i], b[i], 1e-14);
}

TEST(Neural, VariantsHaveThePapersSizes) {
    EXPECT_EQ(appearance_model("neural").num_shared, 816);
    EXPECT_EQ(appearance::NeuralOneLayer::kNumShared, 560);
    EXPECT_EQ(appearance::NeuralThreeLayers::kNumShared, 1072);
    EXPECT_EQ(appearance::NeuralWide::kNumShared, 2144);
    EXPECT_EQ(appearance::NeuralPlain::kNumShared, 816);
    EXPECT_EQ(appearance::NeuralPlain::kFeatures, 16);
}

TEST(Neural, SaturatedOutputKeepsItsGradient) {
    // 1 - tanh^2 would be 0 in float for outputs beyond 9, and the weights could never return.
    std::vector<float> w(Neural::kNumShared, 0.2f), dw(w.size());
    const float f[8] = {.1f, .2f, .3f, .4f, .5f, .6f, .7f, .8f};
    float df[8] = {};
    Vec3<float> dd;
    EXPECT_EQ(Neural::residual(w.data(), f, {0, 0, 1}, 3).x, 1);
    Neural::residual_backward(w.data(), f, {0, 0, 1}, 3, {1, 1, 1}, df, dd, dw.data());
    EXPECT_GT(dw[Neural::kFirstOutput], 0);
    for (const float x : dw) EXPECT_TRUE(std::isfinite(x));
}

}  // namespace
}  // namespace gs
