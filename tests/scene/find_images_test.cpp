// SPDX-License-Identifier: Apache-2.0
// Files that are there are found, however the dataset spells them, and no file is taken for two images.
#include "lib/scene/image_files.h"

#include <gtest/gtest.h>

#include "lib/scene/masks.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using namespace test;

/// Makes empty files.
void touch(const TempFolder& folder, const std::vector<std::string>& names) {
    for (const std::string& name : names) {
        fs::create_directories((folder / name).parent_path());
        spit(folder / name, "x");
    }
}

/// Returns the file of each name relative to the folder: "-" for none, "?" for a contested one.
std::vector<std::string> found(const TempFolder& folder, const std::vector<std::string>& names,
                               OutsideNames outside = OutsideNames::kForeign) {
    std::vector<std::string> files;
    for (const FoundImage& image : find_images(folder.path(), names, outside).images)
        files.push_back(image.file           ? image.file->lexically_relative(folder.path()).generic_string()
                        : image.is_contested ? "?"
                                             : "-");
    return files;
}

using Names = std::vector<std::string>;

TEST(FindImages, TakesOtherExtensionsAndUpperAndLowerCase) {
    TempFolder folder;
    touch(folder, {"A.JPG", "b.jfif", "c.jpe", "d.png", "e.jpg.png", "f", "g.x.JPEG", "sub/H.png"});
    EXPECT_EQ(found(folder, {"a.jpg", "b.jfif", "c.jpeg", "d", "e.jpg", "f", "g.x", "SUB/h.PNG", "none.jpg"}),
              (Names{"A.JPG", "b.jfif", "c.jpe", "d.png", "e.jpg.png", "f", "g.x.JPEG", "sub/H.png", "-"}));
    EXPECT_TRUE(mentions(find_images(folder.path(), {"a.jpg", "d"}, OutsideNames::kForeign).facts,
                         "1 image names are spelled differently from their files (first: 'a.jpg' is A.JPG)"));
    EXPECT_EQ(found(folder, {"frame.0001"}), Names{"-"}) << "a number is no extension";
}

TEST(FindImages, ComposedAndDecomposedLettersAreTheSame) {
    const std::string composed =
                          "K\xC3\xBC"
                          "che.jpg",
                      decomposed =
                          "Ku\xCC\x88"
                          "che.jpg";
    for (const auto& [disk, model] : {std::pair(composed, decomposed), std::pair(decomposed, composed)}) {
        TempFolder folder;
        touch(folder, {disk});
        EXPECT_EQ(found(folder, {model}), Names{disk});
    }
    const std::string latin =
        "K\xFC"
        "che.jpg";
    TempFolder folder;
    touch(folder, {latin});
    EXPECT_EQ(found(folder, {latin}), Names{latin}) << "bytes that are no UTF-8 are themselves";
}

TEST(FindImages, NamesInOlderEncodingsAreFoundAndSaid) {
    const std::string utf8 = "\xE5\xAE\xA2\xE5\x8E\x85.jpg", gbk = "\xBF\xCD\xCC\xFC.jpg";
    for (const auto& [disk, model] : {std::pair(utf8, gbk), std::pair(gbk, utf8)}) {
        TempFolder folder;
        touch(folder, {disk});
        const FoundImages images = find_images(folder.path(), {model}, OutsideNames::kForeign);
        ASSERT_TRUE(images.images[0].file);
        EXPECT_TRUE(mentions(images.notes, "1 image names are in another encoding")) << disk;
        EXPECT_TRUE(mentions(images.notes, "GB18030")) << disk;
    }
}

TEST(FindImages, BackslashesAreFolders) {
    TempFolder folder;
    touch(folder, {"cam0/a.jpg", "b\\c.jpg"});
    EXPECT_EQ(found(folder, {"cam0\\a.jpg", "b\\c.jpg"}), (Names{"cam0/a.jpg", "b\\c.jpg"}));
}

TEST(FindImages, EndsOfNamesTellWhereFilesLie) {
    TempFolder folder;
    touch(folder, {"001.jpg", "left/002.jpg", "right/002.jpg", "left/003.jpg"});
    EXPECT_EQ(found(folder, {"/home/x/scene/images/001.jpg"}), Names{"001.jpg"});
    EXPECT_EQ(found(folder, {"C:\\data\\img\\001.jpg"}), Names{"001.jpg"});
    EXPECT_EQ(found(folder, {"images/left/002.jpg", "D:/other/right/002.JPG"}),
              (Names{"left/002.jpg", "right/002.jpg"}));
    EXPECT_EQ(found(folder, {"003.jpg"}), Names{"left/003.jpg"});
    EXPECT_EQ(found(folder, {"002.jpg"}), Names{"?"}) << "two files end so";
    EXPECT_EQ(found(folder, {"right/003.jpg"}), Names{"-"}) << "another folder than the one that is named";
    const FoundImages images =
        find_images(folder.path(), {"/x/images/001.jpg", "003.jpg", "left/002.jpg"}, OutsideNames::kForeign);
    EXPECT_TRUE(mentions(images.notes, "2 images lie in another place"));
    EXPECT_TRUE(mentions(images.notes, "(first: '/x/images/001.jpg' is 001.jpg)"));
    EXPECT_EQ(images.images[1].name, "left/003.jpg");
}

TEST(FindImages, TheFolderOfImagesComesBeforeOthers) {
    TempFolder folder;
    touch(folder, {"images/a.png", "masks/a.png", "depth/b.png"});
    EXPECT_EQ(found(folder, {"a.png", "/home/x/b.png"}, OutsideNames::kTaken), (Names{"images/a.png", "depth/b.png"}));
}

TEST(FindImages, AnotherSpellingIsNoOtherPlace) {
    TempFolder folder;
    touch(folder, {"images/A.png"});
    const FoundImages images = find_images(folder.path(), {"images/a.png"}, OutsideNames::kTaken);
    EXPECT_TRUE(images.notes.empty());
    EXPECT_TRUE(mentions(images.facts, "(first: 'images/a.png' is images/A.png)"));
}

TEST(NameIndex, FindsTheNameThatDiffersLeast) {
    const NameIndex index({"a.png", "left/a.png", "right/a.png", "right/b", "left/c.png", "right/c.png"});
    bool ambiguous = false;
    const auto at = [&](const std::string& name) {
        const auto match = index.find(name, ambiguous);
        return match ? int(match->index) : -1;
    };
    EXPECT_EQ(at("a.png"), 0) << "the very name";
    EXPECT_EQ(at("a"), 0) << "the same folders";
    EXPECT_EQ(at("right/a"), 2);
    EXPECT_EQ(at("b.jpg"), 3);
    EXPECT_EQ(at("t/a.png"), 0);
    EXPECT_EQ(at("t/b"), -1) << "folders are compared whole";
    EXPECT_FALSE(ambiguous);
    EXPECT_EQ(at("c.png"), -1);
    EXPECT_TRUE(ambiguous) << "two names fit";
}

TEST(FindImages, AbsoluteNamesOfThisMachineAreTakenWhereNamesMayLeaveTheFolder) {
    TempFolder folder;
    touch(folder, {"elsewhere/a.jpg", "scene/images/a.jpg"});
    const std::string name = (folder / "elsewhere/a.jpg").string();
    const auto file = [&](OutsideNames outside) {
        return *find_images(folder / "scene", {name}, outside).images[0].file;
    };
    EXPECT_EQ(file(OutsideNames::kTaken), fs::path(name));
    EXPECT_EQ(file(OutsideNames::kForeign), folder / "scene/images/a.jpg");
}

TEST(FindImages, NoFileIsTakenForTwoImages) {
    TempFolder folder;
    touch(folder, {"001.jpg", "a.png"});
    EXPECT_EQ(found(folder, {"cam0/001.jpg", "cam1/001.jpg"}), (Names{"?", "?"})) << "either could be the one";
    EXPECT_EQ(found(folder, {"cam0/001.jpg", "001.jpg"}), (Names{"?", "001.jpg"})) << "it has the very name of one";
    EXPECT_EQ(found(folder, {"a", "a.png"}), (Names{"?", "a.png"}));
    EXPECT_EQ(found(folder, {"a.png", "a.png"}), (Names{"a.png", "a.png"})) << "one name given twice is one image";
}

TEST(ImageFolder, FollowsLinksButNoCircles) {
    TempFolder folder;
    touch(folder, {"elsewhere/cam0/a.jpg", "images/b.jpg"});
    fs::create_directory_symlink(folder / "elsewhere/cam0", folder / "images/cam0");
    fs::create_directory_symlink(folder / "images", folder / "images/cam1");
    fs::create_directory_symlink("..", folder / "elsewhere/cam0/up");
    EXPECT_EQ(ImageFolder(folder / "images").names(), (Names{"b.jpg", "cam0/a.jpg"}));
}

TEST(ImageFolder, PassesOverWhatMacOSAndNetworkStorageLeave) {
    TempFolder folder;
    touch(folder, {"a.jpg", "._a.jpg", "@eaDir/a.jpg", "__MACOSX/a.jpg", ".thumbnails/a.jpg", "Thumbs.db"});
    EXPECT_EQ(ImageFolder(folder.path()).names(), Names{"a.jpg"});
    EXPECT_EQ(found(folder, {".thumbnails/a.jpg"}), Names{".thumbnails/a.jpg"}) << "it is named exactly";
}

TEST(ImageFolder, NamesPhotographsThatAreNotRead) {
    TempFolder folder;
    touch(folder, {"a.jpg", "a.HEIC"});
    Names notes, facts;
    ImageFolder(folder.path()).tell_unread(notes, facts);
    EXPECT_TRUE(notes.empty()) << "the same photograph is there as JPEG";
    EXPECT_TRUE(mentions(facts, "1 photographs are in formats that are not read"));
    touch(folder, {"b.dng", "sub/c.heif"});
    ImageFolder(folder.path()).tell_unread(notes, facts);
    EXPECT_TRUE(mentions(notes, "3 photographs are in formats that are not read: passed over (first: b.dng)"));
    EXPECT_TRUE(mentions(notes, "convert them to JPEG or PNG"));
}

// Where masks are found and what they do.

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
