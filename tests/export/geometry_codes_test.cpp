// SPDX-License-Identifier: Apache-2.0
// Codes of geometry: numbers known from the format's definition, and how far decoding is from what was encoded.
#include "lib/export/geometry_codes.h"

#include <gtest/gtest.h>
#include <cmath>
#include <random>
#include <set>

#include "appearance/contract.h"
#include "appearance/packing.h"
#include "appearance/sh/packing.h"
#include "lib/export/pack_scene.h"
#include "lib/export/packed_model.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

TEST(GeometryCodes, ScalesHaveTheFormatsCodes) {
    const double scales[] = {0, 1e-9, 1e-3, .01, .5, 1, 100, 1e5};
    const int codes[] = {0, 1, 63, 90, 138, 146, 202, 255};
    for (int i = 0; i < 8; ++i) EXPECT_EQ(scale_code(scales[i]), codes[i]) << scales[i];
    const double decoded[] = {.00103431517, .00964098224, .510059269, .988258453, 101.302413, 8103.08393};
    for (int i = 0; i < 6; ++i) EXPECT_NEAR(decode_scale(codes[2 + i]) / decoded[i], 1, 1e-8);
    EXPECT_EQ(decode_scale(0), 0);
}

TEST(GeometryCodes, ScalesComeBackWithin4Percent) {
    double worst = 0;
    for (double ln = -12; ln <= 9; ln += 0.001)
        worst = std::max(worst, std::abs(decode_scale(scale_code(std::exp(ln))) / std::exp(ln) - 1));
    EXPECT_LE(worst, 0.0425);  // half a step of 21/254 in the logarithm
    EXPECT_GT(worst, 0.04);
}

TEST(GeometryCodes, RotationsHaveTheFormatsCodes) {
    const double n = std::sqrt(30.0);
    EXPECT_EQ(rotation_codes({1 / n, 2 / n, 3 / n, 4 / n}), (std::array<int, 3>{149, 170, 122}));
    EXPECT_EQ(rotation_codes({-.5, .5, -.5, .5}), (std::array<int, 3>{42, 212, 170}));
    const double expected[2][4] = {{.184928274, .36555589, .546183507, .730653133},
                                   {-.505859015, .494094852, -.499976934, .5}};
    const auto a = decode_rotation({149, 170, 122}), b = decode_rotation({42, 212, 170});
    for (std::size_t k = 0; k < 4; ++k) {
        EXPECT_NEAR(a[k], expected[0][k], 1e-8);
        EXPECT_NEAR(b[k], expected[1][k], 1e-8);
    }
}

TEST(GeometryCodes, RotationsComeBackWithinTwoDegrees) {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    const auto error = [](const std::array<double, 4>& q) {
        const auto d = decode_rotation(rotation_codes(q));
        double dot = 0, norm = 0;
        for (std::size_t k = 0; k < 4; ++k) dot += q[k] * d[k], norm += q[k] * q[k];
        return 2 * std::acos(std::min(1.0, std::abs(dot) / std::sqrt(norm))) * 180 / M_PI;
    };
    double worst = 0;
    for (int i = 0; i < 200000; ++i)
        worst = std::max(worst, error({normal(random), normal(random), normal(random), i % 10 ? normal(random) : 0}));
    EXPECT_LE(worst, 1.9);
    EXPECT_NEAR(error({0, 0, 0, 1}), 0, 1e-6);
    EXPECT_NEAR(error({0, 0, 0, -5}), 0, 1e-6);
    EXPECT_LE(error({0, 0, -1, 0}), 1.9);
}

TEST(GeometryCodes, WordsAreLaidOutAsTheFormatSays) {
    const BaseRange range{0.5f, -1};
    const GeometryWords words = encode_geometry({{-1, 0, 126.5}, 0.2, {1, -2.5, 0}, {0, 1e-3, 1}, {0, 0, 0, 1}}, range);
    EXPECT_EQ(words[0], 0x33ff0200u);  // codes 0, 2, 255; opacity 51
    EXPECT_EQ(words[1], 0xc1003c00u);  // halves 1 and -2.5
    EXPECT_EQ(words[2], 0x80ff0000u);  // half 0; the axis of no rotation is x: codes 255, 128 (127.5, ties to even)
    EXPECT_EQ(words[3], 0x00923f00u);  // scale codes 0, 63, 146; angle 0
    const PackedGeometry back = decode_geometry(words, range);
    EXPECT_EQ(back.base, (std::array<double, 3>{-1, 0, 126.5}));
    EXPECT_EQ(back.opacity, 0.2);
    EXPECT_EQ(back.mean, (std::array<double, 3>{1, -2.5, 0}));
}

TEST(GeometryCodes, ExtremesStayFinite) {
    const PackedGeometry back = decode_geometry(
        encode_geometry({{1e30, -1e30, 0}, 1, {1e30, -1e30, 7e4}, {1e30, 1e-300, 0}, {0, 0, 1e-3, 0}}, {1, 0}), {1, 0});
    EXPECT_EQ(back.base, (std::array<double, 3>{255, 0, 0}));
    EXPECT_EQ(back.mean, (std::array<double, 3>{65504, -65504, 65504}));
    EXPECT_NEAR(back.scale[0], 8103.08393, 1e-4);
    EXPECT_EQ(back.scale[2], 0);
}

TEST(ShFields, StraddleWordsAndKeepTheirSign) {
    const int band1[9] = {1, -1, 2, -2, 63, -63, 0, 5, -5};
    std::uint32_t words[4] = {};
    for (int f = 0; f < 9; ++f) appearance::set_field(words, 7, f, band1[f]);
    EXPECT_EQ(words[0], 0xffc0bf81u);
    EXPECT_EQ(words[1], 0x7b0a020bu);
    for (int f = 0; f < 9; ++f) EXPECT_EQ(appearance::get_field(words, 7, f), band1[f]);
    std::uint32_t band3[4] = {};
    for (int f = 0; f < 21; ++f) appearance::set_field(band3, 6, f, f - 31);
    const std::uint32_t expected[4] = {0xa59238a1, 0xbaa9a279, 0xc2fbadb2, 0x35d33cb1};
    for (int k = 0; k < 4; ++k) EXPECT_EQ(band3[k], expected[k]);
    for (int f = 0; f < 21; ++f) EXPECT_EQ(appearance::get_field(band3, 6, f), f - 31);
    appearance::set_field(band3, 6, 5, 31);  // across the first boundary, over what was there
    for (int f = 0; f < 21; ++f) EXPECT_EQ(appearance::get_field(band3, 6, f), f == 5 ? 31 : f - 31);
}

// The ranges of codes: a few outliers do not coarsen all others, and what many show is not cut off.

/// Returns Gaussians with colours like those of trained scenes and opacities around a half.
Gaussians dull_gaussians(const AppearanceSpec& appearance) {
    Gaussians g = random_gaussians(1000, appearance);
    for (float& x : g[Group::kBase].param) x *= 0.2f;
    for (float& x : g[Group::kResidual].param) x *= 0.1f;
    return g;
}

TEST(BaseRange, OutliersDoNotCoarsenTheOthers) {
    for (int activation = 0; activation < 4; ++activation) {
        Gaussians g = dull_gaussians({"none", 0, ColorActivation(activation)});
        const double before = pack_gaussians(g).base_range.scale;
        std::fill_n(g[Group::kBase].param.begin(), 3, 40.0f);
        std::fill_n(g[Group::kBase].param.begin() + 3, 3, -40.0f);
        std::fill_n(g[Group::kBase].param.begin() + 6, 3, -1e30f);
        EXPECT_LE(pack_gaussians(g).base_range.scale, 1.2 * before) << "activation " << activation;
    }
}

TEST(BaseRange, ColoursBelowBlackTakeNoCodes) {
    Gaussians g = dull_gaussians({"none", 0, ColorActivation::kRelu});
    for (std::size_t k = 0; k < g[Group::kBase].param.size(); k += 6) g[Group::kBase].param[k] = -5;
    EXPECT_GE(pack_gaussians(g).base_range.offset, -0.1);
    // They take codes with a residual that lifts them to where they are seen.
    g = dull_gaussians({"sv", 1, ColorActivation::kRelu});
    for (std::int64_t i = 0; i < g.count; i += 6) {
        std::fill_n(g[Group::kBase].param.begin() + 3 * i, 3, -5.0f);
        std::fill_n(g[Group::kResidual].param.begin() + i * g[Group::kResidual].width + 4, 3, 5.0f);
    }
    const BaseRange range = pack_gaussians(g).base_range;
    EXPECT_LE(range.offset, -4.5);
    EXPECT_GE(range.offset + 255 * range.scale, 0.9);
}

TEST(BaseRange, BrightColoursOfManyFaintGaussiansAreKept) {
    Gaussians g = dull_gaussians({"none", 0, ColorActivation::kRelu});
    for (std::int64_t i = 0; i < g.count; i += 20) {
        g[Group::kOpacity].param[std::size_t(i)] = -2;
        std::fill_n(g[Group::kBase].param.begin() + 3 * i, 3, 4.0f);
    }
    const PackedScene scene = pack_gaussians(g);
    for (std::int64_t i = 0; i < g.count; i += 20)
        EXPECT_NEAR(packed_color(scene, i, {0, 0, 1}).x, 4.5, 0.51 * scene.base_range.scale);
}

TEST(BandScales, OutliersDoNotCoarsenTheOthers) {
    Gaussians g = dull_gaussians({"sh", 3, ColorActivation::kRelu});
    const auto before = pack_gaussians(g).appearance.header.floats;
    float* fields = g[Group::kResidual].param.data();
    fields[3] = 100, fields[45 + 14] = -100, fields[90 + 40] = 1e30f;  // of bands 1, 2, 3
    const auto after = pack_gaussians(g).appearance.header.floats;
    for (std::size_t band = 0; band < 3; ++band) EXPECT_LE(after[band], 1.2f * before[band]) << "band " << band + 1;
}

TEST(SampleRows, HasTheLargestAndStandsForAll) {
    GroupArrays<float> group{2, std::vector<float>(2 * 50000), {}, {}};
    for (std::int64_t i = 0; i < 50000; ++i) group.param[std::size_t(2 * i + 1)] = float(i % 5 == 0 ? -2 - i : 1);
    std::set<std::int64_t> rows;
    double sum = 0;
    for (const SampledRow& sampled : sample_rows(group, 1, 1)) {
        EXPECT_TRUE(rows.insert(sampled.row).second);
        EXPECT_EQ(sampled.stands_for, sampled.row % 5 == 0 ? 1 : 4);
        sum += sampled.stands_for;
    }
    EXPECT_EQ(rows.size(), 20000u);
    EXPECT_EQ(sum, 50000);
    group.param.resize(6);
    EXPECT_EQ(sample_rows(group, 0, 2).size(), 3u);
    group.param.clear();
    EXPECT_TRUE(sample_rows(group, 0, 2).empty());
}

}  // namespace
}  // namespace gs::test
