// SPDX-License-Identifier: Apache-2.0
// Adam, schedules and random numbers against published values.
#include <gtest/gtest.h>
#include <bit>
#include <cmath>

#include "kernels/base/rng.h"
#include "kernels/base/schedule.h"
#include "kernels/optimizer/packed_moments.h"
#include "kernels/optimizer/update_device.h"
#include "kernels/state/adam_device.h"

namespace gs::test {
namespace {

TEST(Adam, MatchesTheTextbookForm) {
    double p = 1, m = 0, v = 0, q = 1, a = 0, b = 0;
    for (int t = 1; t <= 50; ++t) {
        const double g = std::sin(1.7 * t);
        adam_update(p, m, v, g, AdamStep<double>::at(0.01, t));
        a = 0.9 * a + 0.1 * g;
        b = 0.999 * b + 0.001 * g * g;
        q -= 0.01 * (a / (1 - std::pow(0.9, t))) / (std::sqrt(b / (1 - std::pow(0.999, t))) + 1e-15);
        EXPECT_NEAR(p, q, 1e-13);
    }
}

// A parameter whose gradient stays zero until its degree is activated jumps by this many learning rates.
TEST(Adam, FirstStepAfterALongRest) {
    for (const auto& [t, want] : {std::pair{1001, 2.5153}, {2001, 2.9410}, {3001, 3.0828}}) {
        double p = 0, m = 0, v = 0;
        adam_update(p, m, v, 0.3, AdamStep<double>::at(1.0, t));
        EXPECT_NEAR(-p, want, 1e-4);
    }
}

TEST(Adam, ZeroRateMovesMomentsOnly) {
    float p = 2, m = 0, v = 0;
    adam_update(p, m, v, 1.0f, AdamStep<float>::at(0, 1));
    EXPECT_EQ(p, 2);
    EXPECT_FLOAT_EQ(m, 0.1f);
    EXPECT_FLOAT_EQ(v, 0.001f);
}

TEST(Adam, ZeroGradientOnZeroMomentsIsExactlyStill) {
    float p = 2, m = 0, v = 0;
    adam_update(p, m, v, 0.0f, AdamStep<float>::at(0.1, 5));
    EXPECT_EQ(p, 2);
}

TEST(Adam, SurvivesTheLargestGradient) {
    float p = 1, m = 0, v = 0;
    for (int t = 1; t <= 3; ++t) adam_update(p, m, v, 3e38f, AdamStep<float>::at(0.1, t));
    EXPECT_TRUE(std::isfinite(v)) << "its square is not";
    EXPECT_NEAR(p, 0.7f, 1e-4f) << "a full step each";
}

/// The parameters and moments of one Gaussian without a residual, all 0.
struct OneGaussian {
    float parameter[kNumGroups][8] = {}, moment[kNumGroups][8] = {}, second[kNumGroups][8] = {};
    ModelArrays arrays{};
    OneGaussian() {
        const int widths[kNumGroups] = {3, 3, 4, 1, 3, 0};
        for (int g = 0; g < kNumGroups; ++g)
            arrays.param[g] = parameter[g], arrays.m[g] = moment[g], arrays.v[g] = second[g],
            arrays.width[g] = widths[g];
    }
    float* operator[](Group g) { return parameter[int(g)]; }
};

TEST(Opacity, ComesBackFromWhereItsSlopeIsZero) {
    // Raw 50 is opacity 1 in float, with slope 0. The update puts it where one is left.
    OneGaussian gaussian;
    gaussian[Group::kOpacity][0] = 50;
    GaussianGradient<float> gradient{};
    update_gaussian(gaussian.arrays, UpdateArgs{}, 0, 1, gradient);
    EXPECT_EQ(gaussian[Group::kOpacity][0], float(kMaxRawOpacity));
    EXPECT_GT(1 - sigmoid(gaussian[Group::kOpacity][0]), 0);
}

/// Returns how far a mean at (x, 0, 0) moves in its first step, in rates.
float step_of_mean(float x, float far_rate) {
    OneGaussian gaussian;
    gaussian[Group::kMean][0] = x;
    GaussianGradient<float> gradient{};
    gradient.geometry.mean = {0, -1, 0};
    StepRequest request;
    request.rates.groups[int(Group::kMean)] = 0.5;
    request.rates.center = {1, 0, 0}, request.rates.extent = 2, request.rates.far = far_rate;
    request.loss.opacity_reg = request.loss.scale_reg = 0;
    update_gaussian(gaussian.arrays, update_args(request, 1, 1), 0, 1, gradient);
    return gaussian[Group::kMean][1] / 0.5f;
}

TEST(FarRate, RaisesTheRateOfMeansBeyondTheExtent) {
    for (const float x : {-7.0f, 0.0f, 2.9f, 9.0f, 1e6f}) EXPECT_EQ(step_of_mean(x, 0), step_of_mean(1, 0)) << x;
    EXPECT_NEAR(step_of_mean(1, 0), 1, 1e-5) << "the first step is one rate";
    for (const float x : {-0.9f, 1.0f, 2.9f}) EXPECT_EQ(step_of_mean(x, 1), step_of_mean(1, 0)) << "within the extent";
    EXPECT_NEAR(step_of_mean(9, 1), 4, 1e-4);
    EXPECT_NEAR(step_of_mean(-7, 1), 4, 1e-4);
    EXPECT_NEAR(step_of_mean(9, 0.5f), 2, 1e-4);
    EXPECT_NEAR(step_of_mean(2e6f + 1, 1) / 1e6, 1, 1e-4);
}

TEST(Rotation, WithoutADirectionIsCulled) {
    for (const float length : {0.0f, 1e-20f, 1e-5f, 1e9f, 1e20f, std::nanf("")})
        EXPECT_FALSE(usable_rotation(Vec4<float>{length, 0, 0, 0})) << length;
    for (const float length : {1e-3f, 1.0f, 1e3f}) EXPECT_TRUE(usable_rotation(Vec4<float>{length, 0, 0, 0})) << length;
}

TEST(Schedule, MatchesThePublishedTable) {
    const Schedule cosine = Schedule::cosine(1, 7000, 37000, 0, 1),
                   delayed = Schedule::cosine(1, 1000, 27000, 0.1, 0, true), warm = Schedule::warm_up(1);
    struct Row {
        double it, cosine, delayed, warm;
    };
    for (const Row& r : {Row{1, 1, 0, 5.2356856e-4},
                         {1000, 1, 1, 0.463059369},
                         {1001, 1, 0.999999997, 0.463443682},
                         {1500, 1, 0.999178999, 0.630209585},
                         {3000, 1, 0.986923818, 0.794328235},
                         {7000, 1, 0.886829837, 0.584341413},
                         {10000, 0.975528258, 0.759125427, 0.464158883},
                         {14000, 0.871572413, 0.55, 0.341454887},
                         {15000, 0.834565303, 0.495758494, 0.316227766},
                         {22000, 0.5, 0.179657260, 0.184784980},
                         {27000, 0.25, 0.1, 0.125892541},
                         {27001, 0.249954656, 0, 0.125882879},
                         {30000, 0.128427587, 0, 0.1}}) {
        EXPECT_NEAR(cosine.at(r.it), r.cosine, 1e-7) << r.it;
        EXPECT_NEAR(delayed.at(r.it), r.delayed, 1e-7) << r.it;
        EXPECT_NEAR(warm.at(r.it), r.warm, 1e-7) << r.it;
    }
    const Schedule means = Schedule::log_linear(1.6e-4, 1.6e-6, 30000);
    EXPECT_NEAR(means.at(15000), 1.6e-5, 1e-12);
    EXPECT_NEAR(means.at(40000), 1.6e-6, 1e-15);
    EXPECT_EQ(Schedule::log_linear(0, 0, 30000).at(10), 0);
}

// Known answers of the Random123 distribution (philox 4x32, 10 rounds), mapped to our counter order.
TEST(Philox, KnownAnswers) {
    const Philox4 zero = philox(0, RngStream(0), 0, 0);
    EXPECT_EQ(zero.v[0], 0x6627e8d5u);
    EXPECT_EQ(zero.v[1], 0xe169c58du);
    EXPECT_EQ(zero.v[2], 0xbc57ac4cu);
    EXPECT_EQ(zero.v[3], 0x9b00dbd8u);
    const Philox4 ones = philox(~0ull, RngStream(~0u), ~0ull, ~0u);
    EXPECT_EQ(ones.v[0], 0x408f276du);
    EXPECT_EQ(ones.v[1], 0x41c83b0eu);
    EXPECT_EQ(ones.v[2], 0xa20bc7c6u);
    EXPECT_EQ(ones.v[3], 0x6d5451fdu);
}

TEST(Philox, NormalsHaveUnitVariance) {
    double sum = 0, squares = 0;
    constexpr int n = 50000;
    for (int i = 0; i < n; ++i) {
        float x[4];
        normals_from(philox(7, RngStream::kNoise, 3, i), x);
        for (float v : x) sum += v, squares += double(v) * v;
    }
    EXPECT_NEAR(sum / (4 * n), 0, 0.01);
    EXPECT_NEAR(squares / (4 * n), 1, 0.01);
    EXPECT_GT(uniform_from_bits<float>(0), 0);
    EXPECT_LT(uniform_from_bits<float>(~0u), 1);
}

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
