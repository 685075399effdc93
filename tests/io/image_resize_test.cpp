// SPDX-License-Identifier: Apache-2.0
// Resizing: exact box averages, means, alpha, enlarging.
#include <cmath>
#include <numeric>

#include <gtest/gtest.h>

#include "kernels/base/error.h"
#include "lib/io/image.h"

namespace gs {
namespace {

Image float_image(int width, int height, int channels, std::vector<float> values) {
    return {width, height, channels, {}, std::move(values)};
}

TEST(Resize, IntegerFactorsAverageBlocks) {
    const Image out = resize_image(float_image(4, 2, 1, {1, 3, 10, 20, 5, 7, 30, 40}), 2, 1);
    EXPECT_FLOAT_EQ(out.f32[0], 4);
    EXPECT_FLOAT_EQ(out.f32[1], 25);
}

TEST(Resize, FractionalFactorsWeighByArea) {
    // 3 -> 2: each output covers one and a half inputs.
    const Image out = resize_image(float_image(3, 1, 1, {1, 2, 4}), 2, 1);
    EXPECT_FLOAT_EQ(out.f32[0], (1 + 0.5f * 2) / 1.5f);
    EXPECT_FLOAT_EQ(out.f32[1], (0.5f * 2 + 4) / 1.5f);
}

TEST(Resize, ShrinkingKeepsTheMean) {
    std::vector<float> values(101 * 67 * 3);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = float((i * 2654435761u % 1000) / 1000.0);
    const Image in = float_image(101, 67, 3, values);
    const auto mean = [](const Image& image) {
        return std::accumulate(image.f32.begin(), image.f32.end(), 0.0) / double(image.f32.size());
    };
    for (const auto& [w, h] : {std::pair{50, 33}, {100, 66}, {7, 5}, {1, 1}})
        EXPECT_NEAR(mean(resize_image(in, w, h)), mean(in), 1e-5);
}

TEST(Resize, InvisibleColourDoesNotBleed) {
    Image in{2, 1, 4, {255, 0, 0, 255, 0, 255, 0, 0}, {}};
    const Image out = resize_image(in, 1, 1);
    EXPECT_EQ(out.u8, (std::vector<std::uint8_t>{255, 0, 0, 128}));
}

TEST(Resize, EnlargingIsLinearBetweenPixelCentres) {
    const Image out = resize_image(float_image(2, 1, 1, {0, 1}), 4, 3);
    const float expected[4] = {0, 0.25f, 0.75f, 1};
    for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 4; ++x) EXPECT_FLOAT_EQ(out.f32[y * 4 + x], expected[x]);
}

TEST(Resize, EightBitRoundsToNearestAndConstantStaysConstant) {
    EXPECT_EQ(resize_image(Image{2, 1, 1, {10, 11}, {}}, 1, 1).u8[0], 11);
    for (const int v : {0, 1, 77, 254, 255}) {
        Image in{13, 9, 3, std::vector<std::uint8_t>(13 * 9 * 3, std::uint8_t(v)), {}};
        for (const auto& [w, h] : {std::pair{5, 4}, {20, 30}, {13, 4}})
            for (const std::uint8_t got : resize_image(in, w, h).u8) EXPECT_EQ(got, v);
    }
}

TEST(Resize, SameSizeIsACopyAndEmptyTargetsAreRefused) {
    const Image in{2, 1, 4, {1, 2, 3, 0, 5, 6, 7, 8}, {}};
    EXPECT_EQ(resize_image(in, 2, 1).u8, in.u8);
    EXPECT_THROW(resize_image(in, 0, 1), UsageError);
}

}  // namespace
}  // namespace gs
