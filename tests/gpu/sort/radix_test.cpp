// SPDX-License-Identifier: Apache-2.0
// The radix sort on the device against std::stable_sort. Skipped where there is no device.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "tests/gpu/gpu_test.h"
#include "tests/gpu/sort/sort_on_device.h"

namespace gs::test {
namespace {

using GpuSort = Gpu;

template <class Key> std::vector<std::uint32_t> sorted_positions(const std::vector<Key>& keys, int bits, Key least) {
    const std::uint32_t mask = std::uint32_t((std::uint64_t(1) << bits) - 1);
    std::vector<std::uint32_t> order;
    for (std::size_t i = 0; i < keys.size(); ++i)
        if (keys[i] >= least) order.push_back(std::uint32_t(i));
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return (keys[a] & mask) < (keys[b] & mask); });
    return order;
}

template <class Key> void expect_sorted(const std::vector<Key>& keys, int bits, std::int64_t room) {
    const std::vector<std::uint32_t> order = sorted_positions(keys, bits, Key(0));
    std::vector<std::uint32_t> begins(kMostNotedKey + 1, kNoPlace);
    for (std::size_t k = order.size(); k-- > 0;)
        begins[std::min<std::uint32_t>(keys[order[k]], kMostNotedKey)] = std::uint32_t(k);
    const SortedOnDevice sorted = sort_on_device(keys, bits, 0, room);
    ASSERT_EQ(sorted.values, order) << keys.size() << " keys of " << bits << " bits";
    ASSERT_EQ(sorted.begins, begins) << keys.size() << " keys of " << bits << " bits";
}

/// Sizes about those of a warp's and of a block's share (4096), and one of more blocks than are resident at once.
constexpr std::int64_t kSizes[] = {0, 1, 31, 32, 33, 511, 512, 4095, 4096, 4097, 8192, 100'003, 3'000'001};

template <class Key> std::vector<Key> random_keys(std::int64_t n, int bits) {
    std::mt19937 rng{std::uint32_t(bits)};
    const std::uint32_t most = std::uint32_t((std::uint64_t(1) << bits) - 1);
    std::vector<Key> keys(static_cast<std::size_t>(n));
    for (Key& key : keys) key = Key(std::uniform_int_distribution<std::uint32_t>(0, most)(rng));
    return keys;
}

template <class Key> void expect_sorted_at_all_sizes(int bits) {
    for (const std::int64_t n : kSizes) {
        const std::vector<Key> keys = random_keys<Key>(n, bits);
        expect_sorted(keys, bits, std::max<std::int64_t>(n, 1));
        expect_sorted(keys, bits, n + 5000);
    }
}

TEST_F(GpuSort, KeysOfAllWidths) {
    expect_sorted_at_all_sizes<std::uint16_t>(1);
    expect_sorted_at_all_sizes<std::uint16_t>(12);
    expect_sorted_at_all_sizes<std::uint16_t>(14);
    expect_sorted_at_all_sizes<std::uint16_t>(15);
    expect_sorted_at_all_sizes<std::uint16_t>(16);
    expect_sorted_at_all_sizes<std::uint32_t>(17);
    expect_sorted_at_all_sizes<std::uint32_t>(24);
    expect_sorted_at_all_sizes<std::uint32_t>(32);
}

TEST_F(GpuSort, EqualKeysKeepTheirOrder) {
    for (const std::uint16_t key : {0, 1, 255, 256, 16383})
        expect_sorted(std::vector<std::uint16_t>(50'000, key), 14, 50'000);
    std::vector<std::uint16_t> two(50'000);
    for (std::size_t i = 0; i < two.size(); ++i) two[i] = i % 3 ? 5 : 65534;
    expect_sorted(two, 16, 60'000);
}

TEST_F(GpuSort, KeysInOrderAndBackwards) {
    std::vector<std::uint32_t> keys(300'000);
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = std::uint32_t(7 * i);
    expect_sorted(keys, 24, 300'000);
    std::reverse(keys.begin(), keys.end());
    expect_sorted(keys, 24, 300'000);
}

TEST_F(GpuSort, MorePairsThanThereIsRoomForAreNotTouched) {
    const std::vector<std::uint16_t> keys(10'000, 3);
    for (const std::int64_t room : {1, 4096, 9'999}) {
        const SortedOnDevice sorted = sort_on_device(keys, 14, 0, room);
        EXPECT_EQ(sorted.values, std::vector<std::uint32_t>(std::size_t(room), kUntouchedValue));
        EXPECT_EQ(sorted.begins, std::vector<std::uint32_t>(kMostNotedKey + 1, kNoPlace));
    }
}

/// Keys as preprocessing writes them: 24 bits of depth, and above them tiles; 0 for culled Gaussians.
class GpuDepthSort : public Gpu {
  protected:
    static constexpr int kBits = 24;
    static constexpr std::uint32_t kLeast = 1u << kBits, kMany = 255;

    static std::uint32_t key_of(std::uint32_t depth, std::uint32_t tiles) {
        return tiles == 0 ? 0 : depth | std::min(tiles, kMany) << kBits;
    }
    /// Expects the order of the depths and the sums of tiles in parts of it.
    static void expect_order_and_sums(const std::vector<std::uint32_t>& depths,
                                      const std::vector<std::uint32_t>& tiles) {
        std::vector<std::uint32_t> keys;
        for (std::size_t i = 0; i < depths.size(); ++i) keys.push_back(key_of(depths[i], tiles[i]));
        const std::vector<std::uint32_t> order = sorted_positions(keys, kBits, kLeast);
        const auto sorted = sort_on_device(keys, kBits, kLeast, std::int64_t(keys.size()), tiles);
        ASSERT_EQ(sorted.values, order);
        std::vector<std::uint32_t> chunks(sorted.chunk_sums.size()), groups(sorted.group_sums.size());
        for (std::size_t k = 0; k < order.size(); ++k)
            chunks[k / kPairsOfChunk] += tiles[order[k]], groups[k / kPairsOfGroup] += tiles[order[k]];
        ASSERT_EQ(sorted.chunk_sums, chunks);
        ASSERT_EQ(sorted.group_sums, groups);
    }
};

TEST_F(GpuDepthSort, LeavesOutCulledGaussiansAndAddsUpTiles) {
    std::mt19937 rng{9};
    for (const std::int64_t n : kSizes) {
        if (n == 0) continue;
        for (const double visible : {0.0, 0.01, 0.5, 1.0}) {
            const std::vector<std::uint32_t> depths = random_keys<std::uint32_t>(n, kBits);
            std::vector<std::uint32_t> tiles(depths.size());
            for (std::uint32_t& t : tiles)
                if (std::uniform_real_distribution<>()(rng) < visible)
                    t = rng() % 16 ? 1 + rng() % 8 : 200 + rng() % 500;
            expect_order_and_sums(depths, tiles);
        }
    }
}

TEST_F(GpuDepthSort, FewDepthsAndSingleGaussians) {
    std::vector<std::uint32_t> depths(200'000, 77), tiles(200'000, 3);
    expect_order_and_sums(depths, tiles);
    for (std::size_t i = 0; i < depths.size(); ++i) depths[i] = i % 3 ? 0 : (1u << kBits) - 1;
    expect_order_and_sums(depths, tiles);
    std::fill(tiles.begin(), tiles.end(), 0);
    tiles[100'000] = 300'000;
    expect_order_and_sums(depths, tiles);
    tiles[0] = 254, tiles.back() = 255;
    expect_order_and_sums(depths, tiles);
}

}  // namespace
}  // namespace gs::test
