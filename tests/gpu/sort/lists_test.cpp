// SPDX-License-Identifier: Apache-2.0
// The lists of a view's tiles: each instance is in its tile's list once, in the order of depth. Skipped where there is
// no device.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "tests/gpu/gpu_test.h"
#include "tests/gpu/sort/lists_on_device.h"

namespace gs::test {
namespace {

constexpr float kOpacity = 0.5f;

/// Returns a round splat that ends `radius` pixels from its mean.
WireSplat disc(float x, float y, float radius, float depth, int width, int height) {
    const float conic = 2 * splat_threshold(kOpacity, 255.0f) / (radius * radius);
    // Within whole tiles, as those of the device are.
    const auto within = [](float value, int size) { return std::clamp(int(value), 0, size); };
    width = (width + kTileX - 1) / kTileX * kTileX, height = (height + kTileY - 1) / kTileY * kTileY;
    const PixelBounds b{within(std::floor(x - radius) - 1, width), within(std::ceil(x + radius) + 1, width),
                        within(std::floor(y - radius) - 1, height), within(std::ceil(y + radius) + 1, height)};
    return WireSplat::of({{x, y}, conic, 0, conic, kOpacity, {}, 0}, b, depth);
}

class GpuLists : public Gpu {
  protected:
    std::mt19937 rng_{3};
    float random(float least, float most) { return std::uniform_real_distribution<float>(least, most)(rng_); }

    static void expect_lists(const std::vector<WireSplat>& splats, int width, int height) {
        const int tiles_x = (width + kTileX - 1) / kTileX, tiles_y = (height + kTileY - 1) / kTileY;
        const auto room = std::int64_t(list_on_device(splats, width, height, 1, false).num_instances);
        const ListsOnDevice plain = list_on_device(splats, width, height, std::max<std::int64_t>(room, 1), false),
                            slots = list_on_device(splats, width, height, room + 1000, true);
        ASSERT_EQ(plain.stopped, false);
        ASSERT_TRUE(plain.cleared && slots.cleared);
        ASSERT_EQ(plain.num_visible, std::ranges::count_if(plain.counts, [](std::uint32_t n) { return n > 0; }));
        ASSERT_EQ(plain.offsets.back(), plain.num_instances);
        ASSERT_EQ(plain.offsets, slots.offsets);
        std::vector<double> radii;
        for (const WireSplat& s : splats)
            radii.push_back(std::sqrt(2 * splat_threshold(double(kOpacity), 255.0) / double(s.a)));
        std::vector<std::uint32_t> listed(splats.size());
        std::vector<std::set<std::uint32_t>> slots_of(splats.size());
        for (int tile = 0; tile < tiles_x * tiles_y; ++tile) {
            const std::size_t begin = plain.offsets[std::size_t(tile)], end = plain.offsets[std::size_t(tile) + 1];
            std::vector<std::pair<std::uint32_t, std::uint32_t>> list;
            for (std::size_t k = begin; k < end; ++k) {
                const std::uint32_t g = plain.instances[k];
                ASSERT_LT(g, splats.size());
                list.push_back({plain.depths[g], g});
                ++listed[g];
                const std::uint32_t slot = slots.instances[k];
                ASSERT_LT(slot, slots.gaussians.size());
                ASSERT_EQ(slots.gaussians[slot], g);
                slots_of[g].insert(slot);
            }
            ASSERT_TRUE(std::is_sorted(list.begin(), list.end())) << "tile " << tile;
            ASSERT_TRUE(std::adjacent_find(list.begin(), list.end()) == list.end()) << "tile " << tile;
            expect_discs(splats, radii, list, tile % tiles_x * kTileX, tile / tiles_x * kTileY);
            if (HasFatalFailure()) return;
        }
        for (std::size_t g = 0; g < splats.size(); ++g) ASSERT_EQ(listed[g], plain.counts[g]) << g;
        expect_slots(slots, slots_of);
        const std::set<std::uint32_t> worked_on(plain.tiles_worked_on.begin(), plain.tiles_worked_on.end());
        ASSERT_EQ(worked_on.size(), plain.tiles_worked_on.size());
        ASSERT_EQ(worked_on.size(), std::size_t(tiles_x * tiles_y));
        ASSERT_EQ(*worked_on.rbegin(), std::uint32_t(tiles_x * tiles_y - 1));
    }

  private:
    /// Expects that the slots of each splat follow each other, and that those behind the visible ones have none.
    static void expect_slots(const ListsOnDevice& lists, const std::vector<std::set<std::uint32_t>>& slots_of) {
        std::uint32_t begin = 0;
        for (std::size_t k = 0; k < lists.slot_ends.size(); ++k) {
            const std::uint32_t end = lists.slot_ends[k];
            if (k >= lists.order.size()) {
                ASSERT_EQ(end, begin);
                continue;
            }
            const std::set<std::uint32_t>& slots = slots_of[lists.order[k]];
            ASSERT_FALSE(slots.empty());
            ASSERT_EQ(slots.size(), end - begin);
            ASSERT_EQ(*slots.begin(), begin);
            ASSERT_EQ(*slots.rbegin(), end - 1);
            begin = end;
        }
        ASSERT_EQ(begin, lists.num_instances);
    }
    /// Expects that the list of the tile at (x, y) has the discs that reach the rectangle of its pixels' centres.
    static void expect_discs(const std::vector<WireSplat>& splats, const std::vector<double>& radii,
                             const std::vector<std::pair<std::uint32_t, std::uint32_t>>& list, int x, int y) {
        std::set<std::uint32_t> listed;
        for (const auto& [depth, g] : list) listed.insert(g);
        for (std::uint32_t g = 0; g < splats.size(); ++g) {
            const WireSplat& s = splats[g];
            const double dx = s.mean_x - std::clamp(double(s.mean_x), x + 0.5, x + kTileX - 0.5),
                         dy = s.mean_y - std::clamp(double(s.mean_y), y + 0.5, y + kTileY - 0.5),
                         distance = std::hypot(dx, dy);
            if (distance < radii[g] * 0.9999) {
                ASSERT_TRUE(listed.contains(g)) << g << " in the tile at " << x << ", " << y;
            }
            if (distance > radii[g] * 1.001) {
                ASSERT_FALSE(listed.contains(g)) << g << " in the tile at " << x << ", " << y;
            }
        }
    }
};

TEST_F(GpuLists, NeighboursInMemoryThatAreNeighboursOnScreen) {
    std::vector<WireSplat> splats;
    for (int k = 0; k < 5000; ++k)
        splats.push_back(disc(k % 1000 / 4.0f, k / 25.0f, random(1, 12), random(1, 9), 256, 200));
    expect_lists(splats, 256, 200);
}

TEST_F(GpuLists, AllInOneTile) {
    std::vector<WireSplat> splats;
    for (int k = 0; k < 5000; ++k) splats.push_back(disc(24, 18, 2, k % 2 ? 5.0f : random(1, 9), 64, 48));
    expect_lists(splats, 64, 48);
}

TEST_F(GpuLists, DiscsInNoOrderInManyTiles) {
    std::vector<WireSplat> splats;
    for (int k = 0; k < 4000; ++k)
        splats.push_back(disc(random(0, 1600), random(0, 1200), random(20, 34), random(1, 9), 1600, 1200));
    expect_lists(splats, 1600, 1200);
}

TEST_F(GpuLists, DiscsLargerThanTheImageAndSmallOnesAndNone) {
    std::vector<WireSplat> splats;
    for (int k = 0; k < 700; ++k) {
        const float radius = k % 7 == 0 ? random(100, 2000) : random(0.5f, 40);
        splats.push_back(disc(random(-50, 450), random(-50, 1350), radius, random(1, 9), 400, 1300));
        if (k % 5 == 0) splats.push_back(disc(-500, -500, 3, 2, 400, 1300));  // out of sight
    }
    expect_lists(splats, 400, 1300);
}

TEST_F(GpuLists, SmallestImageAndNoSplats) {
    expect_lists({}, 1, 1);
    expect_lists({}, 300, 200);
    expect_lists({disc(0.5f, 0.5f, 3, 2, 1, 1), disc(0.5f, 0.5f, 3, 1, 1, 1)}, 1, 1);
}

TEST_F(GpuLists, WhatDoesNotFitIsNotListed) {
    std::vector<WireSplat> splats;
    for (int k = 0; k < 300; ++k) splats.push_back(disc(random(0, 100), random(0, 100), k % 2 ? 90 : 5, 2, 100, 100));
    const auto needed = std::int64_t(list_on_device(splats, 100, 100, 1, false).num_instances);
    for (const std::int64_t room : {std::int64_t(1), needed / 2, needed - 1}) {
        const ListsOnDevice binned = list_on_device(splats, 100, 100, room, false);
        EXPECT_TRUE(binned.stopped);
        EXPECT_EQ(binned.num_instances, std::uint64_t(needed));
        EXPECT_EQ(binned.offsets, std::vector<std::uint32_t>(binned.offsets.size()));
    }
    EXPECT_FALSE(list_on_device(splats, 100, 100, needed, false).stopped);
}

}  // namespace
}  // namespace gs::test
