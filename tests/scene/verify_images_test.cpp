// SPDX-License-Identifier: Apache-2.0
// Damaged images are found before the training, and the others are decoded once.
#include "lib/scene/verify_images.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <atomic>
#include <chrono>

#include "kernels/base/error.h"
#include "lib/core/quantities.h"
#include "lib/scene/image_cache.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

/// The names a.png, b.png, ... of `n` images.
std::vector<std::string> letters(int n) {
    std::vector<std::string> names;
    for (int i = 0; i < n; ++i) names.push_back(std::string(1, char('a' + i)) + ".png");
    return names;
}

void cut_in_half(const std::filesystem::path& file) {
    std::filesystem::resize_file(file, std::filesystem::file_size(file) / 2);
}

/// A scene of ten images 64x48 on a line. With eval, a.png and i.png are test views.
class VerifyImages : public ::testing::Test {
  protected:
    VerifyImages() {
        write_model(folder_ / "sparse/0", {{1, 1, 64, 48, {80, 80, 32, 24}}}, row_of_images(letters(10)),
                    {{1, 0, 0, 0}});
        for (const std::string& name : letters(10)) write_png(image(name), 64, 48);
    }
    std::filesystem::path image(const std::string& name) const { return folder_ / "images" / name; }
    Scene load(bool eval) const {
        SceneOptions options;
        options.source = folder_.path().string();
        options.eval = eval;
        return load_scene(options, {.scores = eval});
    }
    static constexpr std::size_t kImageBytes = 64 * 48 * 3;
    TempFolder folder_;
};

void verify(Scene& scene, std::size_t keep_bytes = 1 << 30) {
    verify_images(scene, keep_bytes, [](std::int64_t, std::int64_t) {});
}

TEST_F(VerifyImages, TruncatedTestImageIsAnErrorThatNamesIt) {
    cut_in_half(image("i.png"));
    Scene scene = load(true);  // its header is whole
    const std::string message = message_of<DataError>([&] { verify(scene); });
    EXPECT_CONTAINS(message, "1 of 2 test images");
    EXPECT_CONTAINS(message, image("i.png").string());
}

TEST_F(VerifyImages, UnreadableTestImageIsAnErrorWhenTheSceneIsLoaded) {
    spit(image("i.png"), "");
    EXPECT_CONTAINS(message_of<DataError>([&] { load(true); }), image("i.png").string());
    EXPECT_EQ(load(false).train.size(), 9u) << "without scores it is left out like any other";
}

TEST_F(VerifyImages, UnreadableTrainingImageDoesNotMoveTheSplit) {
    spit(image("c.png"), "");
    const Scene scene = load(true);
    ASSERT_EQ(scene.test.size(), 2u);
    EXPECT_EQ(scene.test[1].name, "i.png");
    EXPECT_EQ(scene.train.size(), 7u);
}

TEST_F(VerifyImages, TruncatedTrainingImageIsSkipped) {
    cut_in_half(image("j.png"));
    Scene scene = load(true);
    const double extent = scene.extent;
    verify(scene);
    EXPECT_EQ(scene.train.size(), 7u);
    EXPECT_EQ(scene.test.size(), 2u);
    EXPECT_LT(scene.extent, extent) << "j.png is the outermost";
    ASSERT_FALSE(scene.notes.empty());
    EXPECT_CONTAINS(scene.notes.back(), "1 of 8 training images cannot be decoded");
    EXPECT_CONTAINS(scene.notes.back(), image("j.png").string());
    for (const std::string& name : letters(9)) cut_in_half(image(name));
    Scene none = load(false);
    EXPECT_CONTAINS(message_of<DataError>([&] { verify(none); }), "10 of 10 training images");
}

TEST_F(VerifyImages, DamagedMaskIsFound) {
    write_png(folder_ / "masks/b.png", 64, 48);
    cut_in_half(folder_ / "masks/b.png");
    Scene scene = load(false);
    verify(scene);
    EXPECT_EQ(scene.train.size(), 9u);
    EXPECT_CONTAINS(scene.notes.back(), "masks/b.png");
}

TEST_F(VerifyImages, MasksThatLeaveNothingOrLittleAreNamedAndCounted) {
    const auto write_mask = [&](const std::string& name, std::uint8_t value) {
        std::filesystem::create_directories(folder_ / "masks");
        write_image(folder_ / "masks" / name, Image{64, 48, 3, std::vector<std::uint8_t>(64 * 48 * 3, value), {}});
    };
    write_mask("b.png", 0), write_mask("c.png", 255), write_mask("d.png", 3), write_mask("e.png", 0);
    for (const MaskMode mode : {MaskMode::kIgnore, MaskMode::kTransparent}) {
        SceneOptions options;
        options.source = folder_.path().string();
        options.mask_mode = mode;
        Scene scene = load_scene(options);
        verify(scene);
        EXPECT_TRUE(mentions(scene.notes, "2 of 4 masks are all black")) << scene.notes.back();
        EXPECT_TRUE(mentions(scene.notes, "masks/b.png, " + (folder_ / "masks/e.png").string()));
        EXPECT_TRUE(mentions(scene.notes, "1 of 4 masks are dark all over"));
        EXPECT_EQ(scene.train.size(), 10u);
    }
}

TEST_F(VerifyImages, NothingIsDecodedTwiceWhereAllFits) {
    Scene scene = load(true);
    const Image first = scene.train[0].load().color;
    std::int64_t done = 0;
    verify_images(scene, 10 * kImageBytes, [&](std::int64_t n, std::int64_t total) {
        EXPECT_EQ(n, ++done);
        EXPECT_EQ(total, 10);
    });
    EXPECT_EQ(done, 10);
    std::filesystem::remove_all(folder_ / "images");
    ImageCache cache(scene.train, 10 * kImageBytes, 0);
    for (std::size_t k = 0; k < scene.train.size(); ++k) cache.get(k);
    EXPECT_EQ(cache.num_decodes(), 0u);
    EXPECT_EQ(cache.get(0)->color.u8, first.u8);
    for (const View& view : scene.test) EXPECT_EQ(view_image(view)->color.width, 64);
}

TEST_F(VerifyImages, ASmallerCacheKeepsTrainingImagesOrNone) {
    for (const std::size_t images : {9, 7}) {
        Scene scene = load(true);
        verify(scene, images * kImageBytes);
        for (const View& view : scene.train) EXPECT_EQ(view.decoded != nullptr, images == 9);
        for (const View& view : scene.test) EXPECT_EQ(view.decoded, nullptr);
    }
}

// The image cache: budget, eviction order, prefetch, errors, threads; and byte sizes as users write them.

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

}  // namespace
}  // namespace gs::test
