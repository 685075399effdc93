// SPDX-License-Identifier: Apache-2.0
// The CPU's sort of Gaussians into tiles, against a stable comparison sort.
#include "kernels/sort/binning.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/splat/depth_key.h"

namespace gs {
namespace {

constexpr std::uint32_t kTiles = 37;

struct BinnedGaussian {
    std::uint32_t depth_key;
    std::vector<std::uint32_t> tiles;
};

BinningInput input_of(const std::vector<BinnedGaussian>& gaussians) {
    BinningInput in;
    in.parts.resize(num_parts(std::int64_t(gaussians.size())));
    for (std::size_t i = 0; i < gaussians.size(); ++i) {
        auto& part = in.parts[i / kPartSize];
        const auto& tiles = gaussians[i].tiles;
        in.first.push_back(std::uint32_t(part.tiles.size()));
        in.count.push_back(std::uint32_t(tiles.size()));
        part.tiles.insert(part.tiles.end(), tiles.begin(), tiles.end());
        if (!tiles.empty()) part.depth_keys.push_back(std::uint64_t(gaussians[i].depth_key) << 32 | i);
    }
    return in;
}

void expect_sorted(TileBinning& binning, const std::vector<BinnedGaussian>& gaussians) {
    struct Expected {
        std::uint32_t tile, depth_key, gaussian, slot;
    };
    std::vector<Expected> expected;
    std::int64_t visible = 0;
    for (std::uint32_t i = 0; i < gaussians.size(); ++i) {
        visible += !gaussians[i].tiles.empty();
        for (const std::uint32_t tile : gaussians[i].tiles)
            expected.push_back({tile, gaussians[i].depth_key, i, std::uint32_t(expected.size())});
    }
    std::stable_sort(expected.begin(), expected.end(), [](const Expected& a, const Expected& b) {
        return a.tile != b.tile ? a.tile < b.tile : a.depth_key < b.depth_key;
    });

    binning.build(input_of(gaussians), kTiles, 1 << 30);
    EXPECT_EQ(binning.num_visible(), visible);
    ASSERT_EQ(binning.instances().size(), expected.size());
    ASSERT_EQ(binning.offsets().size(), kTiles + 1);
    EXPECT_EQ(binning.offsets()[kTiles], expected.size());
    for (std::size_t k = 0; k < expected.size(); ++k) {
        ASSERT_EQ(binning.instances()[k].gaussian, expected[k].gaussian) << k;
        ASSERT_EQ(binning.instances()[k].slot, expected[k].slot) << k;
        ASSERT_LE(binning.offsets()[expected[k].tile], k);
        ASSERT_LT(k, binning.offsets()[expected[k].tile + 1]);
    }
}

/// Makes Gaussians with up to `max_tiles` tiles, and keys from next_key(rng).
template <class Key> std::vector<BinnedGaussian> random_binned(std::size_t n, std::uint32_t max_tiles, Key&& next_key) {
    std::mt19937 rng{std::uint32_t(n)};
    std::vector<BinnedGaussian> gaussians(n);
    for (auto& g : gaussians) {
        g.depth_key = next_key(rng);
        g.tiles.resize(rng() % (max_tiles + 1));
        for (std::size_t k = 0; k < g.tiles.size(); ++k) g.tiles[k] = std::uint32_t(rng() % (kTiles - 5) + k);
    }
    return gaussians;
}

TEST(Binning, EqualsAStableComparisonSort) {
    TileBinning binning;  // one for all: what an earlier view left must not matter
    const auto any_key = [](std::mt19937& rng) { return std::uint32_t(rng() % kDepthKeyEnd); };
    for (const int threads : {1, 3}) {
        set_num_threads(threads);
        for (const std::size_t n : {100000, 20000, 1025, 1024, 17, 1}) {
            SCOPED_TRACE(n);
            expect_sorted(binning, random_binned(n, 3, any_key));
        }
    }
    set_num_threads(0);
}

TEST(Binning, EqualKeysKeepTheOrderOfTheGaussians) {
    TileBinning binning;
    expect_sorted(binning, random_binned(30000, 2, [](std::mt19937&) { return 0xabcdefu; }));
}

TEST(Binning, EveryDigitOfTheKeyCounts) {
    TileBinning binning;
    for (const std::uint32_t digit : {1u, 1u << 7, 1u << 8, 1u << 15, 1u << 16, 1u << 23})
        expect_sorted(binning,
                      random_binned(5000, 1, [=](std::mt19937& rng) { return std::uint32_t(rng() % 2) * digit; }));
}

TEST(Binning, NothingToSort) {
    TileBinning binning;
    expect_sorted(binning, {});
    expect_sorted(binning, std::vector<BinnedGaussian>(3000));  // all culled
    expect_sorted(binning, {{7, {kTiles - 1}}});
}

TEST(Binning, TheLimitOfInstancesIsExact) {
    TileBinning binning;
    const BinningInput in = input_of({{5, {0, 1, 2}}, {3, {1}}});
    binning.build(in, kTiles, 4);
    EXPECT_EQ(binning.instances().size(), 4u);
    EXPECT_THROW(binning.build(in, kTiles, 3), DeviceError);
}

}  // namespace
}  // namespace gs
