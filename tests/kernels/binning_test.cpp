// SPDX-License-Identifier: Apache-2.0
// The CPU's sort of Gaussians into tiles, against a stable comparison sort.
#include "kernels/sort/binning.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "kernels/cuda/device_code.h"
#include "kernels/engines/instance_forecast.h"
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

constexpr std::int64_t kUnknown = std::numeric_limits<std::int64_t>::max();

TEST(InstanceForecast, KnowsNothingOfANewView) {
    InstanceForecast f;
    EXPECT_EQ(f.most({3}), kUnknown);
    f.note({3}, 1'000'000);
    EXPECT_GE(f.most({3}), 1'000'000);
    EXPECT_LT(f.most({3}), 1'500'000);
    EXPECT_EQ(f.most({4}), kUnknown);
    EXPECT_EQ(f.most({.view = 3, .factor = 2}), kUnknown);
    f.note({-1}, 1'000'000);
    EXPECT_EQ(f.most({-1}), kUnknown);
}

// 40 views that differ by up to four times, while all grow by a thousandth a step.
TEST(InstanceForecast, FollowsATrainingThatGrows) {
    InstanceForecast f;
    double level = 500'000;
    int known = 0;
    for (int step = 0; step < 2000; ++step, level *= 1.001) {
        const int view = step * 7 % 40;
        const auto n = std::int64_t(level * (1 + 3 * view / 39.0));
        if (step >= 40) {
            const std::int64_t most = f.most({view});
            EXPECT_GE(most, n) << step;
            EXPECT_LE(most, n * 1.5 + 20'000) << step;
            ++known;
        }
        f.note({view}, n);
    }
    EXPECT_EQ(known, 1960);
}

// Opacities are reset: views have a third of their instances, and soon as many as before.
TEST(InstanceForecast, FollowsAResetWithFewSteps) {
    InstanceForecast f;
    int too_many = 0;
    for (int step = 0; step < 3000; ++step) {
        const int view = step * 7 % 40, since = step % 1000;
        const double level = step < 1000 ? 1e6 : 1e6 * (1 - 0.7 * std::exp(-since / 100.0));
        const auto n = std::int64_t(level * (1 + view / 39.0));
        if (n > f.most({view})) ++too_many;
        f.note({view}, n);
    }
    EXPECT_LE(too_many, 30);
}

// One view fills up, and disturbs no other.
TEST(InstanceForecast, OneViewThatChangesDoesNotMoveTheOthers) {
    InstanceForecast f;
    for (int view = 0; view < 40; ++view) f.note({view}, view == 0 ? 0 : 1'000'000);
    for (int step = 0; step < 400; ++step) {
        const int view = step * 7 % 40;
        if (view) {
            EXPECT_GE(f.most({view}), 1'000'000) << step;
            EXPECT_LE(f.most({view}), 2'000'000) << step;
        }
        f.note({view}, 1'000'000);
    }
    EXPECT_GE(f.most({0}), 1'000'000);
    EXPECT_LE(f.most({0}), 2'000'000);
}

TEST(InstanceForecast, TakesViewsWithoutInstances) {
    InstanceForecast f;
    for (int k = 0; k < 100; ++k) f.note({k % 2}, k % 2 ? 1'000'000 : 0);
    EXPECT_GE(f.most({0}), 0);
    EXPECT_GE(f.most({1}), 1'000'000);
}

/// Adds a whole window of n, with `once` in the middle, and returns what comes at its end.
std::int64_t add_window(RecentMost& recent, std::int64_t n, std::int64_t once = 0) {
    std::optional<std::int64_t> most;
    for (int k = 0; k < RecentMost::kWindow; ++k) {
        EXPECT_FALSE(most) << "only at the end of a window";
        most = recent.add(k == RecentMost::kWindow / 2 ? std::max(n, once) : n);
    }
    EXPECT_TRUE(most);
    return most.value_or(-1);
}

TEST(RecentMost, ForgetsAfterTwoWindows) {
    RecentMost recent;
    EXPECT_EQ(add_window(recent, 10), 10);
    EXPECT_EQ(add_window(recent, 5, 1000), 1000);
    EXPECT_EQ(add_window(recent, 5), 1000);
    EXPECT_EQ(add_window(recent, 5), 5);
    EXPECT_EQ(add_window(recent, 0), 5);
    EXPECT_EQ(add_window(recent, 0), 0);
}

// Which GPUs a build's code runs on, and what is said to the owners of the others.

bool runs(const std::string& architectures, int major, int minor) {
    return why_no_code(architectures, "GPU", major, minor).empty();
}

TEST(DeviceCode, RunsWithinItsMajorVersionAndPtxOnAllLaterGpus) {
    EXPECT_TRUE(runs("sm_86", 8, 6));
    EXPECT_TRUE(runs("sm_86", 8, 9));
    EXPECT_FALSE(runs("sm_86", 8, 0));
    EXPECT_FALSE(runs("sm_80", 9, 0));
    EXPECT_FALSE(runs("sm_90+PTX", 8, 9)) << "what was the default, on an RTX 40";
    EXPECT_TRUE(runs("sm_80+PTX", 8, 6));
    EXPECT_TRUE(runs("sm_80+PTX", 12, 0));
    EXPECT_TRUE(runs("compute_80", 9, 0));
    EXPECT_FALSE(runs("compute_90", 8, 0));
    EXPECT_FALSE(runs("sm_90a", 10, 0));
    EXPECT_FALSE(runs("sm_100 sm_120", 9, 0));
    EXPECT_TRUE(runs("sm_80 sm_90 sm_120+PTX", 9, 0));
    EXPECT_TRUE(runs("native", 9, 0)) << "only a kernel can tell";
}

TEST(DeviceCode, NamesTheGpuTheBuildAndTheCommandThatMendsIt) {
    const std::string why = why_no_code("sm_90+PTX", "NVIDIA GeForce RTX 3090", 8, 6);
    EXPECT_NE(why.find("NVIDIA GeForce RTX 3090 (sm_86) cannot run this gsapp, which was built for sm_90+PTX"),
              std::string::npos)
        << why;
    EXPECT_NE(why.find("-DCMAKE_CUDA_ARCHITECTURES=86"), std::string::npos) << why;
}

TEST(DeviceCode, SaysThatAGpuIsTooOldAndOffersNoBuildForIt) {
    const std::string why = why_no_code("sm_80+PTX", "Tesla T4", 7, 5);
    EXPECT_NE(why.find("Tesla T4 (sm_75) is older"), std::string::npos) << why;
    EXPECT_EQ(why.find("CMAKE_CUDA_ARCHITECTURES"), std::string::npos) << why;
}

}  // namespace
}  // namespace gs
