// SPDX-License-Identifier: Apache-2.0
// Undistortion: size rule, remapping against an analytic image, masks, lenses that cannot be undistorted.
#include "lib/scene/view_builder.h"

#include <gtest/gtest.h>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/scene/resized.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

LensCamera opencv_lens(double k1, double k2 = 0) {
    return make_lens_camera(CameraModel::kOpenCV, 120, 90,
                            std::vector<double>{100, 102, 61, 44, k1, k2, 0.001, -0.0005});
}

/// A smooth, slow pattern, for which bilinear interpolation is nearly exact.
float pattern(double u, double v) { return float(0.5 + 0.2 * std::sin(3 * u + 1) + 0.2 * std::cos(2 * v - u)); }

Image distorted_pattern(const LensCamera& lens) {
    Image image{lens.width, lens.height, 3, {}, {}};
    for (int y = 0; y < lens.height; ++y)
        for (int x = 0; x < lens.width; ++x) {
            const auto ray = unproject(lens, {x + 0.5, y + 0.5});
            for (int c = 0; c < 3; ++c)
                image.f32.push_back(pattern(ray->x() / ray->z(), ray->y() / ray->z()) * float(c + 1));
        }
    return image;
}

/// A camera whose lens is used at all angles.
Camera whole(const LensCamera& lens) { return {lens, {M_PI}}; }

TEST(Undistort, PinholeStaysUntouched) {
    const LensCamera lens = make_lens_camera(CameraModel::kPinhole, 100, 80, std::vector<double>{50, 60, 49, 41});
    const Camera camera = undistorted_camera(lens, "x");
    EXPECT_EQ(camera.width, 100);
    EXPECT_EQ(camera.height, 80);
    EXPECT_EQ(camera.fx, 50);
    EXPECT_EQ(camera.cy, 41);
}

TEST(Undistort, ResultIsThePinholeViewOfTheSameRays) {
    for (const double k1 : {-0.2, 0.15}) {
        const LensCamera lens = opencv_lens(k1, 0.02);
        const Camera camera = undistorted_camera(lens, "x");
        EXPECT_EQ(camera.fx, lens.fx);
        EXPECT_EQ(camera.fy, lens.fy);
        // Barrel distortion squeezes the view: without blank pixels its pinhole image is larger, pincushion smaller.
        EXPECT_EQ(camera.width > lens.width, k1 < 0);
        EXPECT_DOUBLE_EQ(camera.cx, lens.cx * camera.width / lens.width);
        const ViewImage out = undistort({distorted_pattern(lens), {}}, whole(lens), camera);
        EXPECT_FALSE(out.mask) << "the size rule leaves no blank pixels";
        double worst = 0;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const double u = (x + 0.5 - camera.cx) / camera.fx, v = (y + 0.5 - camera.cy) / camera.fy;
                worst = std::max(worst, std::abs(double(out.color.value(x, y, 1)) - 2 * pattern(u, v)));
            }
        EXPECT_LT(worst, 2e-3) << "k1 " << k1;  // bilinear error of this pattern, plus half-pixel borders
    }
}

TEST(Undistort, MaskFollowsTheColour) {
    const LensCamera lens = opencv_lens(-0.2);
    const Camera camera = undistorted_camera(lens, "x");
    Image mask{lens.width, lens.height, 1, std::vector<std::uint8_t>(lens.width * lens.height, 255), {}};
    Image color{lens.width, lens.height, 3, std::vector<std::uint8_t>(lens.width * lens.height * 3, 200), {}};
    const int mx = 20, my = 70;
    for (int y = my - 4; y <= my + 4; ++y)
        for (int x = mx - 4; x <= mx + 4; ++x) mask.u8[y * lens.width + x] = 0;
    const ViewImage out = undistort({color, mask}, whole(lens), camera);
    ASSERT_TRUE(out.mask);
    const auto at = project(camera, *unproject(lens, {mx + 0.5, my + 0.5}));
    EXPECT_EQ(out.mask->value(int(at->x()), int(at->y()), 0), 0);
    EXPECT_EQ(out.mask->value(camera.width / 2, camera.height / 2, 0), 1);
    EXPECT_EQ(out.color.u8[0], 200);
}

TEST(Undistort, PixelsWithoutSourceAreMasked) {
    const LensCamera lens = opencv_lens(0.15);
    Camera wide = undistorted_camera(lens, "x");
    wide.fx /= 2;  // sees twice the angle
    wide.fy /= 2;
    const ViewImage out = undistort({test::gradient_image(lens.width, lens.height), {}}, whole(lens), wide);
    ASSERT_TRUE(out.mask);
    EXPECT_EQ(out.mask->value(0, 0, 0), 0);
    EXPECT_EQ(out.mask->value(wide.width / 2, wide.height / 2, 0), 1);
}

TEST(Undistort, AlphaWeighsTheColour) {
    const LensCamera lens = opencv_lens(-0.2);
    Image color{lens.width, lens.height, 4, {}, {}};
    for (int i = 0; i < lens.width * lens.height; ++i) {
        const bool visible = (i / 3) % 2;
        for (const int v : {visible ? 250 : 0, visible ? 0 : 250, 0, visible ? 255 : 0})
            color.u8.push_back(std::uint8_t(v));
    }
    const ViewImage out = undistort({color, {}}, whole(lens), undistorted_camera(lens, "x"));
    for (std::size_t i = 0; i < out.color.u8.size(); i += 4)
        if (out.color.u8[i + 3] > 0) {
            EXPECT_GE(out.color.u8[i], 249);
            EXPECT_EQ(out.color.u8[i + 1], 0);
        }
}

TEST(Undistort, WiderThanAPinholeIsAnErrorWithAHint) {
    const auto message = [](const LensCamera& lens) {
        return test::message_of<DataError>([&] { undistorted_camera(lens, "image 'a.jpg'"); });
    };
    EXPECT_CONTAINS(message(make_lens_camera(CameraModel::kEquirectangular, 80, 40, std::vector<double>{80, 40})),
                    "--lens native");
    const LensCamera fisheye = make_lens_camera(CameraModel::kFisheye, 100, 100, std::vector<double>{30, 30, 50, 50});
    EXPECT_CONTAINS(message(fisheye), "180 degrees");
    EXPECT_CONTAINS(message(fisheye), "image 'a.jpg'");
    LensCamera aside = opencv_lens(-0.1);
    aside.cx = 500;
    EXPECT_CONTAINS(message(aside), "principal point");
}

TEST(Undistort, ModerateFisheyeBecomesPinhole) {
    const LensCamera lens =
        make_lens_camera(CameraModel::kOpenCVFisheye, 100, 80, std::vector<double>{70, 70, 50, 40, 0.01, 0, 0, 0});
    const Camera camera = undistorted_camera(lens, "x");
    EXPECT_GT(camera.width, 100);
    EXPECT_LE(camera.width, 200);
    EXPECT_FALSE(undistort({test::gradient_image(100, 80), {}}, whole(lens), camera).mask);
}

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
