// SPDX-License-Identifier: Apache-2.0
#include "eval/auto/photograph.h"

#include <gtest/gtest.h>

#include <cmath>

#include "kernels/base/error.h"
#include "lib/model/appearance_spec.h"
#include "tests/kernels/backends.h"

namespace gs {
namespace {

/// Returns a view of 4x2 pixels of one colour; the first `masked` do not count.
View view(std::uint8_t value, int masked) {
    View v;
    v.camera.width = 4, v.camera.height = 2;
    v.camera.fx = v.camera.fy = 4, v.camera.cx = 2, v.camera.cy = 1;
    v.load = [value, masked] {
        ViewImage image;
        image.color.width = 4, image.color.height = 2, image.color.channels = 3;
        image.color.u8.assign(24, value);
        if (masked > 0) {
            image.mask.emplace();
            image.mask->width = 4, image.mask->height = 2, image.mask->channels = 1;
            image.mask->u8.assign(8, 255);
            for (int i = 0; i < masked; ++i)
                image.mask->u8[std::size_t(i)] = 127, image.color.u8[std::size_t(3 * i)] = 255;
        }
        return image;
    };
    return v;
}

TEST(Photograph, LeavesOutWhatItsMaskDoes) {
    const std::vector<Photograph> photographs = load_photographs({view(51, 3), view(51, 8), view(51, 0)}, {0, 0, 0});
    ASSERT_EQ(photographs.size(), 2u) << "nothing of the second counts";
    EXPECT_EQ(photographs[0].pixels, (std::vector<std::int32_t>{3, 4, 5, 6, 7}));
    EXPECT_EQ(photographs[1].pixels.size(), 8u);
    const AppearanceSpec none{"none", 0, ColorActivation::kRelu};
    const auto backend = make_cpu_backend(none, {});
    Gaussians nothing;
    nothing.appearance = none;
    for (int k = 0; k < kNumGroups; ++k) nothing.groups[k].width = group_width(Group(k), none);
    backend->upload(nothing);
    const RenderedImage pixels = render_pixels(*backend, photographs[0], {0, 0, 0});
    EXPECT_EQ(pixels.width, 5);
    EXPECT_NEAR(mean_squared_error(pixels, photographs[0]), 0.04, 1e-12) << "pixels that do not count would add to it";
    EXPECT_NEAR(mean_psnr(*backend, photographs, {0, 0, 0}, false), -10 * std::log10(0.04), 1e-9);
    EXPECT_NEAR(mean_psnr(*backend, photographs, {0, 0, 0}, true), 58.92, 0.01)
        << "a constant is what the fit takes off; the rest is less than rounding";
    EXPECT_NEAR(mean_psnr(*backend, load_photographs({view(0, 0)}, {0, 0, 0}), {0, 0, 0}, false), 58.92, 0.01)
        << "nothing, as it is seen";
    EXPECT_TRUE(std::isnan(mean_psnr(*backend, {}, {0, 0, 0}, false)));
}

TEST(Photograph, SaysWhichFileCannotBeRead) {
    View broken = view(0, 0);
    broken.load = []() -> ViewImage { throw DataError("image a.png: truncated"); };
    EXPECT_THROW(load_photographs({view(0, 0), broken}, {0, 0, 0}), DataError);
}

}  // namespace
}  // namespace gs
