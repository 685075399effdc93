// SPDX-License-Identifier: Apache-2.0
// Where masks are found and what they do.
#include "lib/scene/masks.h"

#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;

/// Finds the mask of one image of a COLMAP scene whose images lie in images/.
std::optional<MaskFile> find_mask(const TempFolder& folder, const std::string& image, int factor = 1) {
    std::vector<std::string> names{"images/left/a.jpg", "images/right/a.jpg", "images/a.jpg", "images/b.jpg"};
    for (const std::string& name : names) spit(folder / name, "x");
    MaskFinder masks(folder.path(), names, factor);
    return masks.find("images/" + image, image, folder / ("images/" + image));
}

TEST(FindMask, EveryPlaceAndNamingIsFound) {
    for (const char* place :
         {"masks/left/a.jpg.png", "masks/left/a.jpg", "masks/left/a.png", "masks/left/a.mask.png", "masks/left/a.tif",
          "mask/left/a.png", "sfm_masks/left/a.jpg.png", "masks/left/a.jpg.mask.png", "masks/left/a_mask.png",
          "masks/left/a.jpg_mask.png", "masks/left/a.JPG.Mask.PNG", "masks/left/a_MASK.jpeg", "Masks/left/a.JPG",
          "MASK/LEFT/A.png", "images/left/a.jpg.mask.png", "images/left/a_mask.png", "images/left/a.mask.PNG",
          "masks/images/left/a.png"}) {
        TempFolder folder;
        spit(folder / place, "x");
        const auto mask = find_mask(folder, "left/a.jpg");
        ASSERT_TRUE(mask) << place;
        EXPECT_EQ(mask->path, folder / place);
        EXPECT_FALSE(mask->inverted);
        EXPECT_FALSE(find_mask(folder, "right/a.jpg")) << "sub-folders must match: " << place;
        EXPECT_FALSE(find_mask(folder, "b.jpg")) << place;
    }
}

TEST(FindMask, AFolderOfMasksLiesBesideThatOfItsImages) {
    TempFolder folder;
    const std::vector<std::string> names{"cam0/images/a.png", "cam1/images/a.png", "train/c.png", "test/c.png"};
    for (const std::string& name : names) spit(folder / name, "x");
    for (const char* mask : {"cam0/masks/a.png", "masks/c.png"}) spit(folder / mask, "x");
    MaskFinder masks(folder.path(), names, 1);
    const auto find = [&](const std::string& name) { return masks.find(name, name, folder / name); };
    EXPECT_EQ(find(names[0])->path, folder / "cam0/masks/a.png");
    EXPECT_FALSE(find(names[1]));
    EXPECT_FALSE(find(names[2])) << "it could be that of the image in test/";
    EXPECT_EQ(masks.unused(), std::vector{folder / "masks"});
}

TEST(FindMask, OrderIsColmapNameFirstAndScaledFolderBeforeAll) {
    TempFolder folder;
    spit(folder / "masks/a.png", "x");
    spit(folder / "masks/a.jpg.png", "x");
    spit(folder / "masks_4/a.png", "x");
    EXPECT_EQ(find_mask(folder, "a.jpg")->path, folder / "masks/a.jpg.png");
    EXPECT_EQ(find_mask(folder, "a.jpg", 4)->path, folder / "masks_4/a.png");
    EXPECT_EQ(find_mask(folder, "a.jpg", 2)->path, folder / "masks/a.jpg.png");
    spit(folder / "masks/A.jpg.png", "x");
    EXPECT_EQ(find_mask(folder, "a.jpg")->path, folder / "masks/a.jpg.png") << "the name as it is spelt goes first";
}

TEST(FindMask, PhotographsWithMaskInTheirNamesAreNoMasks) {
    TempFolder folder;
    const std::vector<std::string> names{"images/a.jpg", "images/a_mask.jpg", "images/b.jpg", "images/b.jpg.mask.png"};
    for (const std::string& name : names) spit(folder / name, "x");
    MaskFinder masks(folder.path(), names, 1);
    EXPECT_FALSE(masks.find("images/a.jpg", "a.jpg", folder / "images/a.jpg"));
    EXPECT_TRUE(masks.find("images/b.jpg", "b.jpg", folder / "images/b.jpg"));
    EXPECT_TRUE(masks.is_mask("images/b.jpg.mask.png"));
    EXPECT_FALSE(masks.is_mask("images/a_mask.jpg"));
}

TEST(FindMask, DynamicMaskLiesBesideTheImageAndIsInverted) {
    TempFolder folder;
    spit(folder / "images/dynamic_mask_a.png", "x");
    const auto mask = find_mask(folder, "a.jpg");
    ASSERT_TRUE(mask);
    EXPECT_TRUE(mask->inverted);
    EXPECT_FALSE(find_mask(folder, "b.jpg"));
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
