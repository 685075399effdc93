// SPDX-License-Identifier: Apache-2.0
// The image cache: budget, eviction order, prefetch, errors, threads; and byte sizes as users write them.
#include "lib/scene/image_cache.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>

#include "kernels/base/error.h"
#include "lib/core/bytes.h"

namespace gs {
namespace {

constexpr std::size_t kBytes = 300;  // of one image

struct Views {
    std::vector<View> list;
    std::vector<std::shared_ptr<std::atomic<int>>> loads;

    explicit Views(int count) {
        for (int i = 0; i < count; ++i) {
            loads.push_back(std::make_shared<std::atomic<int>>(0));
            View view;
            view.name = std::to_string(i);
            view.camera.width = view.camera.height = 10;
            view.load = [counter = loads.back(), i] {
                ++*counter;
                return ViewImage{Image{10, 10, 3, std::vector<std::uint8_t>(kBytes, std::uint8_t(i)), {}}, {}};
            };
            list.push_back(std::move(view));
        }
    }
};

/// Waits until the background threads have made `count` decodes, or 10 s.
void wait_for_decodes(const ImageCache& cache, std::uint64_t count) {
    for (int i = 0; i < 10000 && cache.num_decodes() < count; ++i)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    ASSERT_GE(cache.num_decodes(), count);
}

TEST(ImageCache, DecodesOnceWithinTheBudget) {
    Views views(4);
    ImageCache cache(views.list, 4 * kBytes, 0);
    for (int round = 0; round < 3; ++round)
        for (int i = 0; i < 4; ++i) EXPECT_EQ(cache.get(i)->color.u8[0], i);
    for (const auto& loads : views.loads) EXPECT_EQ(*loads, 1);
    EXPECT_EQ(cache.resident_bytes(), 4 * kBytes);
    EXPECT_GT(cache.wait_seconds(), 0);
}

TEST(ImageCache, DropsTheLeastRecentlyUsed) {
    Views views(3);
    ImageCache cache(views.list, 2 * kBytes, 0);
    cache.get(0);
    cache.get(1);
    cache.get(0);
    cache.get(2);  // drops 1
    cache.get(0);
    EXPECT_EQ(*views.loads[0], 1);
    cache.get(1);
    EXPECT_EQ(*views.loads[1], 2);
    EXPECT_LE(cache.resident_bytes(), 2 * kBytes);
}

TEST(ImageCache, ZeroBudgetKeepsNothingButStillServes) {
    Views views(2);
    ImageCache cache(views.list, 0, 0);
    const auto image = cache.get(1);
    EXPECT_EQ(cache.resident_bytes(), 0u);
    EXPECT_EQ(image->color.u8[0], 1);
    cache.get(1);
    EXPECT_EQ(*views.loads[1], 2);
}

TEST(ImageCache, PrefetchedImagesWaitForTheirTurnEvenBeyondTheBudget) {
    Views views(4);
    ImageCache cache(views.list, kBytes, 1);
    cache.prefetch(0);
    cache.prefetch(1);
    cache.prefetch(2);
    wait_for_decodes(cache, 3);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(cache.get(i)->color.u8[0], i);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(*views.loads[i], 1) << i;
    EXPECT_LE(cache.resident_bytes(), kBytes) << "afterwards the budget holds again";
}

TEST(ImageCache, PrefetchErrorsSurfaceInGetAndTheNextGetTriesAgain) {
    Views views(2);
    auto fail = std::make_shared<std::atomic<bool>>(true);
    views.list[1].load = [fail]() -> ViewImage {
        if (*fail) throw DataError("image 1 is broken");
        return {Image{10, 10, 3, std::vector<std::uint8_t>(kBytes, 3), {}}, {}};
    };
    ImageCache cache(views.list, 10 * kBytes, 1);
    cache.prefetch(1);
    wait_for_decodes(cache, 1);
    EXPECT_THROW(cache.get(1), DataError);
    EXPECT_THROW(cache.get(1), DataError);
    *fail = false;
    EXPECT_EQ(cache.get(1)->color.u8[2], 3);
    EXPECT_EQ(cache.get(0)->color.u8[0], 0);
}

TEST(ImageCache, PrefetchWithoutThreadsAndUnknownIndicesAreHarmless) {
    Views views(1);
    ImageCache cache(views.list, kBytes, 0);
    cache.prefetch(0);
    EXPECT_EQ(cache.num_decodes(), 0u);
    EXPECT_THROW(cache.get(1), std::out_of_range);
}

TEST(ImageCache, ManyThreadsAlwaysGetTheRightImage) {
    Views views(20);
    ImageCache cache(views.list, 5 * kBytes, 3);
    std::atomic<int> wrong = 0;
    std::vector<std::thread> threads;
    for (int t = 0; t < 4; ++t)
        threads.emplace_back([&, t] {
            for (int k = 0; k < 500; ++k) {
                const int i = (k * 7 + t * 5) % 20;
                cache.prefetch((i + 3) % 20);
                wrong += cache.get(i)->color.u8[0] != i;
            }
        });
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(wrong, 0);
}

TEST(ImageCache, DestructionDropsTheQueue) {
    Views views(50);
    {
        ImageCache cache(views.list, 50 * kBytes, 1);
        for (int i = 0; i < 50; ++i) cache.prefetch(i);
    }
    SUCCEED();
}

TEST(ParseBytes, UnitsAndFractions) {
    EXPECT_EQ(parse_bytes("0"), 0u);
    EXPECT_EQ(parse_bytes("7B"), 7u);
    EXPECT_EQ(parse_bytes("4GiB"), std::uint64_t(4) << 30);
    EXPECT_EQ(parse_bytes("4g"), std::uint64_t(4) << 30);
    EXPECT_EQ(parse_bytes(" 500 MB "), 500000000u);
    EXPECT_EQ(parse_bytes("1.5KiB"), 1536u);
    EXPECT_EQ(parse_bytes("2TiB"), std::uint64_t(2) << 40);
}

TEST(ParseBytes, NonsenseIsAUsageErrorNamingIt) {
    for (const char* text :
         {"", "GiB", "-1", "123", "4 apples", "4GiBs", "1e9999", "nan", "inf", "1,5G", "99999999999TiB", "4kb5"}) {
        try {
            parse_bytes(text);
            ADD_FAILURE() << text << " was accepted";
        } catch (const UsageError& error) {
            EXPECT_NE(std::string(error.what()).find("'" + std::string(text) + "'"), std::string::npos) << error.what();
        }
    }
}

}  // namespace
}  // namespace gs
