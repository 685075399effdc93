// SPDX-License-Identifier: Apache-2.0
// The ranges of codes: a few outliers do not coarsen all others, and what many show is not cut off.
#include "appearance/packing.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "appearance/contract.h"
#include "lib/export/pack_scene.h"
#include "lib/export/packed_model.h"
#include "tests/model/model_helpers.h"

namespace gs::test {
namespace {

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
