// SPDX-License-Identifier: Apache-2.0
// Which images a rank decodes, and when.
#include "lib/train/training_views.h"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <thread>

namespace gs::test {
namespace {

constexpr int kNumViews = 40, kSize = 4;

/// A scene whose views count how often they were decoded.
struct CountedScene {
    std::array<std::atomic<int>, kNumViews> decodes{};
    Scene scene;

    CountedScene() {
        for (int k = 0; k < kNumViews; ++k) {
            View view;
            view.name = std::to_string(k);
            view.camera.width = view.camera.height = kSize;
            view.load = [this, k] {
                ++decodes[std::size_t(k)];
                ViewImage image;
                image.color.width = image.color.height = kSize, image.color.channels = 3;
                image.color.u8.assign(3 * kSize * kSize, std::uint8_t(k));
                return image;
            };
            scene.train.push_back(std::move(view));
        }
    }
};

TEST(TrainingViews, AreDecodedAheadByTheRankThatRendersThemFromItsFirstOn) {
    CountedScene counted;
    TrainOptions options;
    options.device = Device::kCpu;
    TrainingViews views(options, counted.scene);
    views.deal(2, [](int k) { return k == 1; });  // the second of two ranks
    ViewOrder order(kNumViews, options.seed);
    const auto decodes_at = [&](std::int64_t position) { return counted.decodes[order.at(position)].load(); };
    const auto image = views.image_of_rank(std::int64_t(order.at(1)), 1);
    EXPECT_EQ(image->color.u8[0], order.at(1));
    using Clock = std::chrono::steady_clock;
    for (const auto end = Clock::now() + std::chrono::seconds(20); decodes_at(5) == 0 && Clock::now() < end;)
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    for (const int own : {1, 3, 5}) EXPECT_EQ(decodes_at(own), 1) << own;
    for (const int of_the_other : {0, 2, 4, 6}) EXPECT_EQ(decodes_at(of_the_other), 0) << of_the_other;
}

}  // namespace
}  // namespace gs::test
