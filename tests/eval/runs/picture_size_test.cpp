// SPDX-License-Identifier: Apache-2.0
// Sizes of pictures, and what a camera sees in another size.
#include "apps/gsapp/render/camera_path.h"

#include <gtest/gtest.h>

#include "kernels/base/error.h"

namespace gs {
namespace {

TEST(PictureSize, ReadsWhatAPictureCanHave) {
    const PictureSize size = parse_picture_size("1280x720");
    EXPECT_EQ(size.width, 1280);
    EXPECT_EQ(size.height, 720);
    EXPECT_EQ(parse_picture_size("1x1").height, 1);
    EXPECT_EQ(parse_picture_size("8192x4096").width, 8192) << "2^25 pixels";
    EXPECT_EQ(parse_picture_size("32768x1024").width, 32768);
    for (const char* text : {"", "1280", "1280x", "x720", "0x720", "1280x0", "-1280x720", "1280x720x3", "1280X720",
                             "1280 x 720", "1e3x720", "nanx720", "8192x4097", "32769x1", "99999999999x1", "12.5x10"})
        EXPECT_THROW(parse_picture_size(text), UsageError) << text;
    EXPECT_FALSE(picture_size(std::nan(""), 10));
    EXPECT_FALSE(picture_size(10, 10.5));
}

TEST(PictureSize, KeepsTheVerticalFieldOfView) {
    Camera camera;
    camera.width = 40, camera.height = 30, camera.fx = 50, camera.fy = 60, camera.cx = 22, camera.cy = 14;
    const Camera wide = with_vertical_field(camera, {160, 60});
    EXPECT_EQ(wide.width, 160);
    EXPECT_EQ(wide.height, 60);
    EXPECT_DOUBLE_EQ(wide.height / wide.fy, camera.height / camera.fy);
    EXPECT_DOUBLE_EQ(wide.fx / wide.fy, camera.fx / camera.fy) << "pixels keep their shape";
    EXPECT_DOUBLE_EQ(wide.cy, 28);
    EXPECT_DOUBLE_EQ(wide.cx, 80 + 2 * 2) << "two pixels right of the middle, in pixels half as large";
    const Camera same = with_vertical_field(camera, {40, 30});
    EXPECT_EQ(same.fx, camera.fx);
    EXPECT_EQ(same.cx, camera.cx);
}

}  // namespace
}  // namespace gs
