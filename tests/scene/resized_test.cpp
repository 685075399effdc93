// SPDX-License-Identifier: Apache-2.0
#include "lib/scene/resized.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"

namespace gs {
namespace {

View view(int width, int height) {
    View v;
    v.camera.width = width, v.camera.height = height;
    v.camera.fx = 80, v.camera.fy = 90, v.camera.cx = 0.4 * width, v.camera.cy = 0.7 * height;
    v.image_bytes = std::size_t(3 * width * height);
    v.load = [width, height] {
        ViewImage image;
        image.color.width = width, image.color.height = height, image.color.channels = 3;
        for (int i = 0; i < width * height; ++i)
            image.color.u8.insert(image.color.u8.end(), 3, std::uint8_t(i % width < width / 2 ? 200 : 40));
        image.mask.emplace();
        image.mask->width = width, image.mask->height = height, image.mask->channels = 1;
        image.mask->u8.assign(std::size_t(width * height), 255);
        return image;
    };
    return v;
}

TEST(SmallerView, KeepsWhatIsSeen) {
    const View small = smaller_view(view(40, 20), 10);
    EXPECT_EQ(small.camera.width, 10);
    EXPECT_EQ(small.camera.height, 5);
    EXPECT_DOUBLE_EQ(small.camera.fx, 20);
    EXPECT_DOUBLE_EQ(small.camera.fy, 22.5);
    EXPECT_DOUBLE_EQ(small.camera.cx, 4);
    EXPECT_DOUBLE_EQ(small.camera.cy, 3.5);
    EXPECT_EQ(small.image_bytes, 150u);
    const ViewImage image = small.load();
    ASSERT_EQ(image.color.width, 10);
    ASSERT_EQ(image.color.height, 5);
    EXPECT_EQ(image.color.u8[3 * 4], 200);
    EXPECT_EQ(image.color.u8[3 * 5], 40);
    ASSERT_TRUE(image.mask);
    EXPECT_EQ(image.mask->width, 10);
}

TEST(SmallerView, MakesAKeptImageSmaller) {
    View whole = view(40, 20);
    whole.decoded = view_image(whole);
    whole.load = []() -> ViewImage { throw DataError("decoded twice"); };
    EXPECT_EQ(view_image(smaller_view(whole, 10))->color.width, 10);
}

TEST(SmallerView, LeavesSmallViewsAlone) {
    const View small = smaller_view(view(10, 40), 10);
    EXPECT_EQ(small.camera.width, 10);
    EXPECT_EQ(small.camera.height, 40);
    EXPECT_DOUBLE_EQ(small.camera.fx, 80);
}

TEST(SmallerView, NoImageIsWithoutARow) {
    const View flat = smaller_view(view(1000, 1), 10);
    EXPECT_EQ(flat.camera.width, 10);
    EXPECT_EQ(flat.camera.height, 1);
    EXPECT_EQ(flat.load().color.height, 1);
}

}  // namespace
}  // namespace gs
