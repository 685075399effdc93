// SPDX-License-Identifier: Apache-2.0
// Where masks are found and what they do.
#include "lib/scene/masks.h"

#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;

TEST(FindMask, EveryPlaceAndNamingIsFound) {
    for (const char* place : {"masks/left/a.jpg.png", "masks/left/a.jpg", "masks/left/a.png", "masks/left/a.mask.png",
                              "masks/left/a.tif", "mask/left/a.png", "sfm_masks/left/a.jpg.png"}) {
        TempFolder folder;
        spit(folder / place, "x");
        const auto mask = find_mask(folder.path(), "left/a.jpg", folder / "images/left/a.jpg", 1);
        ASSERT_TRUE(mask) << place;
        EXPECT_EQ(mask->path, folder / place);
        EXPECT_FALSE(mask->inverted);
        EXPECT_FALSE(find_mask(folder.path(), "right/a.jpg", folder / "images/right/a.jpg", 1))
            << "sub-folders must match";
    }
}

TEST(FindMask, OrderIsColmapNameFirstAndScaledFolderBeforeAll) {
    TempFolder folder;
    spit(folder / "masks/a.png", "x");
    spit(folder / "masks/a.jpg.png", "x");
    spit(folder / "masks_4/a.png", "x");
    EXPECT_EQ(find_mask(folder.path(), "a.jpg", folder / "images/a.jpg", 1)->path, folder / "masks/a.jpg.png");
    EXPECT_EQ(find_mask(folder.path(), "a.jpg", folder / "images_4/a.jpg", 4)->path, folder / "masks_4/a.png");
    EXPECT_EQ(find_mask(folder.path(), "a.jpg", folder / "images_2/a.jpg", 2)->path, folder / "masks/a.jpg.png");
}

TEST(FindMask, DynamicMaskLiesBesideTheImageAndIsInverted) {
    TempFolder folder;
    spit(folder / "images/dynamic_mask_a.png", "x");
    const auto mask = find_mask(folder.path(), "a.jpg", folder / "images/a.jpg", 1);
    ASSERT_TRUE(mask);
    EXPECT_TRUE(mask->inverted);
    EXPECT_FALSE(find_mask(folder.path(), "b.jpg", folder / "images/b.jpg", 1));
}

TEST(LoadMask, InvertsAndResizes) {
    TempFolder folder;
    Image grey{2, 1, 3, {0, 0, 0, 255, 255, 255}, {}};
    write_image(folder / "m.png", grey);
    EXPECT_EQ(load_mask({folder / "m.png", false}, false, 2, 1).u8, (std::vector<std::uint8_t>{0, 255}));
    EXPECT_EQ(load_mask({folder / "m.png", false}, true, 2, 1).u8, (std::vector<std::uint8_t>{255, 0}));
    EXPECT_EQ(load_mask({folder / "m.png", true}, false, 2, 1).u8, (std::vector<std::uint8_t>{255, 0}));
    EXPECT_EQ(load_mask({folder / "m.png", true}, true, 2, 1).u8, (std::vector<std::uint8_t>{0, 255}));
    EXPECT_EQ(load_mask({folder / "m.png", false}, false, 4, 1).u8, (std::vector<std::uint8_t>{0, 64, 191, 255}));
}

TEST(Combine, IgnoreKeepsTheMaskAsWeight) {
    const Image rgb{2, 1, 3, {1, 2, 3, 4, 5, 6}, {}}, mask{2, 1, 1, {0, 255}, {}};
    const ViewImage view = combine(rgb, mask, AlphaMode::kTransparent, MaskMode::kIgnore);
    EXPECT_EQ(view.color.u8, rgb.u8);
    EXPECT_EQ(view.mask->u8, mask.u8);
    EXPECT_FALSE(combine(rgb, {}, AlphaMode::kMask, MaskMode::kTransparent).mask);
}

TEST(Combine, TransparentMultipliesTheAlpha) {
    const Image mask{2, 1, 1, {0, 128}, {}};
    const ViewImage rgb =
        combine(Image{2, 1, 3, {1, 2, 3, 4, 5, 6}, {}}, mask, AlphaMode::kTransparent, MaskMode::kTransparent);
    EXPECT_EQ(rgb.color.u8, (std::vector<std::uint8_t>{1, 2, 3, 0, 4, 5, 6, 128}));
    EXPECT_FALSE(rgb.mask);
    const ViewImage rgba = combine(Image{2, 1, 4, {1, 2, 3, 255, 4, 5, 6, 128}, {}}, mask, AlphaMode::kTransparent,
                                   MaskMode::kTransparent);
    EXPECT_EQ(rgba.color.u8, (std::vector<std::uint8_t>{1, 2, 3, 0, 4, 5, 6, 64}));
    const ViewImage real =
        combine(Image{2, 1, 3, {}, {1, 2, 3, 4, 5, 6}}, mask, AlphaMode::kTransparent, MaskMode::kTransparent);
    EXPECT_FLOAT_EQ(real.color.f32[7], 128 / 255.0f);
}

TEST(Combine, AlphaModeMaskMovesAlphaIntoTheWeight) {
    const Image rgba{2, 1, 4, {1, 2, 3, 255, 4, 5, 6, 128}, {}};
    const ViewImage alone = combine(rgba, {}, AlphaMode::kMask, MaskMode::kIgnore);
    EXPECT_EQ(alone.color.u8, (std::vector<std::uint8_t>{1, 2, 3, 4, 5, 6}));
    EXPECT_EQ(alone.mask->u8, (std::vector<std::uint8_t>{255, 128}));
    EXPECT_EQ(combine(rgba, Image{2, 1, 1, {0, 128}, {}}, AlphaMode::kMask, MaskMode::kIgnore).mask->u8,
              (std::vector<std::uint8_t>{0, 64}));
}

}  // namespace
}  // namespace gs
