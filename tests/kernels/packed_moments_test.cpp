// SPDX-License-Identifier: Apache-2.0
#include "kernels/optimizer/packed_moments.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

namespace gs::test {
namespace {

struct Moments {
    float m, v;
};
Moments through_a_word(float m, float v, std::uint32_t random) {
    const std::uint32_t word = pack_moments(std::bit_cast<std::uint32_t>(m), std::bit_cast<std::uint32_t>(v), random);
    return {std::bit_cast<float>(first_moment_bits(word)), std::bit_cast<float>(second_moment_bits(word))};
}

TEST(PackedMoments, KeepEightBitsOfTheMantissaAndAllOfTheRange) {
    for (const float x : {1e-30f, 3e-18f, 7.7e-9f, 0.123f, 1.0f, 5e12f, 1e36f})
        for (const float sign : {1.0f, -1.0f}) {
            const Moments q = through_a_word(sign * x, x, 0x8000);
            EXPECT_LE(std::abs(q.m - sign * x), x / 256) << x;
            EXPECT_LE(std::abs(q.v - x), x / 256) << x;
        }
    const Moments zero = through_a_word(0, 0, 0xffff);
    EXPECT_EQ(zero.m, 0);
    EXPECT_EQ(zero.v, 0);
}

TEST(PackedMoments, WordsAreKeptAsTheyAre) {
    const Moments q = through_a_word(-0.37f, 2.3e-11f, 1234);
    for (const std::uint32_t random : {0u, 0x8000u, 0xffffu}) {
        EXPECT_EQ(through_a_word(q.m, q.v, random).m, q.m);
        EXPECT_EQ(through_a_word(q.m, q.v, random).v, q.v);
    }
}

/// The second moment of a gradient that stays the same: each step adds a thousandth of what is missing, less than the
/// last bit.
TEST(PackedMoments, SecondMomentFollowsSmallSteps) {
    constexpr double kSquare = 3.3e-7;
    double mean = 0, nearest = 1e-7;
    constexpr int kRows = 200, kSteps = 3000;
    for (int row = 0; row < kRows; ++row) {
        float v = 1e-7f;
        for (int step = 0; step < kSteps; ++step)
            v = through_a_word(0, float(v + 1e-3 * (kSquare - v)), rounding_bits(mix_bits(step), row)).v;
        mean += double(v) / kRows;
    }
    for (int step = 0; step < kSteps; ++step)
        nearest = through_a_word(0, float(nearest + 1e-3 * (kSquare - nearest)), 0x8000).v;
    const double plain = kSquare + (1e-7 - kSquare) * std::pow(0.999, kSteps);
    EXPECT_NEAR(mean, plain, 0.02 * plain);
    EXPECT_LT(nearest, 0.9 * plain) << "rounding to nearest would do as well";
}

}  // namespace
}  // namespace gs::test
