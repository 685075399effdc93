// SPDX-License-Identifier: Apache-2.0
// Exposure from metadata: reading, missing settings, and what reaches the views of a scene.
#include "lib/scene/exif.h"

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>
#include <cmath>

#include "lib/scene/scene.h"
#include "tests/core/temporary_folder.h"
#include "tests/io/tagged_image.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

/// An image of 16x12 with the settings that are not 0.
void write_photograph(const std::filesystem::path& path, float seconds, int iso, float f_number) {
    std::filesystem::create_directories(path.parent_path());
    OIIO::ImageSpec spec(16, 12, 3, OIIO::TypeDesc::UINT8);
    if (seconds > 0) spec.attribute("ExposureTime", seconds);
    if (iso > 0) spec.attribute("Exif:ISOSpeedRatings", iso);
    if (iso > 0) spec.attribute("Exif:PhotographicSensitivity", iso);
    if (f_number > 0) spec.attribute("FNumber", f_number);
    const std::vector<std::uint8_t> pixels(16 * 12 * 3, 100);
    const auto output = OIIO::ImageOutput::create(path.string());
    ASSERT_TRUE(output && output->open(path.string(), spec) &&
                output->write_image(OIIO::TypeDesc::UINT8, pixels.data()) && output->close());
}

TEST(Exif, SettingsOfAFile) {
    const test::TemporaryFolder folder;
    write_photograph(folder.path() / "a.jpg", 0.01f, 200, 2.8f);
    const ExifSettings full = read_exif_settings(folder.path() / "a.jpg");
    ASSERT_TRUE(full.seconds && full.iso && full.f_number);
    EXPECT_NEAR(*full.seconds, 0.01, 1e-5);
    EXPECT_NEAR(*full.iso, 200, 1e-5);
    EXPECT_NEAR(*full.f_number, 2.8, 1e-5);
    write_photograph(folder.path() / "b.jpg", 0, 0, 0);
    EXPECT_FALSE(read_exif_settings(folder.path() / "b.jpg").seconds);
    folder.write("c.jpg", "no image");
    EXPECT_FALSE(read_exif_settings(folder.path() / "c.jpg").seconds);
    EXPECT_FALSE(read_exif_settings(folder.path() / "missing.jpg").seconds);
}

TEST(Exif, StopsCountLight) {
    const auto stops = exposure_stops({{0.01, 100, 2}, {0.02, 200, 2}, {0.01, 100, 4}});
    EXPECT_NEAR(*stops[0], std::log2(0.01 / 4), 1e-12);
    EXPECT_NEAR(*stops[1] - *stops[0], 2, 1e-12);
    EXPECT_NEAR(*stops[2] - *stops[0], -2, 1e-12);
}

TEST(Exif, ASettingThatAllLackIsEqualInAll) {
    const auto stops = exposure_stops({{0.01, {}, 2}, {0.02, {}, 2}});
    EXPECT_NEAR(*stops[1] - *stops[0], 1, 1e-12);
}

TEST(Exif, AnImageThatLacksWhatOthersHaveGetsNoValue) {
    const auto stops = exposure_stops({{0.01, 100, 2}, {0.02, {}, 2}, {{}, 100, 2}, {0.02, 100, {}}});
    EXPECT_TRUE(stops[0]);
    EXPECT_FALSE(stops[1] || stops[2] || stops[3]);
    EXPECT_TRUE(exposure_stops({}).empty());
}

TEST(Exif, ReachesTheViewsOfBothSetsWhereItIsAskedFor) {
    const test::TemporaryFolder folder;
    test::write_colmap_scene(folder.path(), {"a.jpg", "b.jpg", "c.jpg"});
    write_photograph(folder.path() / "images/a.jpg", 0.01f, 0, 0);
    write_photograph(folder.path() / "images/b.jpg", 0.04f, 0, 0);
    write_photograph(folder.path() / "images/c.jpg", 0, 0, 0);
    SceneOptions options;
    options.source = folder.path().string();
    options.eval = true;
    EXPECT_FALSE(load_scene(options).train[0].exif_exposure);
    options.ppisp_exif = true;
    const Scene scene = load_scene(options);  // a is the test view
    ASSERT_EQ(scene.train.size(), 2u);
    EXPECT_NEAR(*scene.train[0].exif_exposure - *scene.test[0].exif_exposure, 2, 1e-3);
    EXPECT_FALSE(scene.train[1].exif_exposure);
    EXPECT_TRUE(test::mentions(scene.notes, "EXIF: 1 of 3 images"));
}

// Scenes whose photographs carry an EXIF orientation: the sizes of the cameras say whether it counts.

class TaggedScene : public ::testing::Test {
  protected:
    /// A scene of cameras of 16x12 pixels, with images stored in the given size.
    Scene load(int width, int height, int orientation) {
        write_colmap_scene(folder_.path(), {"a.jpg", "b.jpg"});
        for (const char* name : {"a.jpg", "b.jpg"}) write_tagged(folder_ / "images" / name, width, height, orientation);
        SceneOptions options;
        options.source = folder_.path().string();
        return load_scene(options);
    }
    TempFolder folder_;
};

TEST_F(TaggedScene, CamerasOfTheStoredSizeKeepThePixels) {
    for (const int orientation : {3, 6}) {
        const Scene scene = load(16, 12, orientation);
        EXPECT_TRUE(mentions(scene.notes, "2 images have an EXIF orientation: ignored"));
        const ViewImage view = scene.train[0].load();
        EXPECT_EQ(view.color.width, 16);
        EXPECT_GT(view.color.value(1, 6, 0), 0.9f);
    }
}

TEST_F(TaggedScene, CamerasOfTheUprightSizeTurnThePixels) {
    for (const int orientation : {6, 8}) {
        const Scene scene = load(12, 16, orientation);
        EXPECT_TRUE(mentions(scene.notes, "2 images are turned by their EXIF orientation"));
        EXPECT_FALSE(mentions(scene.notes, "differ in size"));
        EXPECT_EQ(scene.train[0].camera.fx, 20);
        EXPECT_EQ(scene.train[0].camera.fy, 20);
        const ViewImage view = scene.train[0].load();
        ASSERT_EQ(view.color.width, 16);
        ASSERT_EQ(view.color.height, 12);
        EXPECT_NEAR(view.color.value(8, 1, 0), orientation == 6 ? 1 : 0, 0.1);
        EXPECT_NEAR(view.color.value(8, 10, 0), orientation == 6 ? 0 : 1, 0.1);
    }
}

TEST_F(TaggedScene, MasksAreTurnedWithTheImageWhereTheyLieAsItDid) {
    Image upright_mask{16, 12, 1, std::vector<std::uint8_t>(16 * 12, 0), {}}, stored_mask{12, 16, 1, {}, {}};
    std::fill_n(upright_mask.u8.begin(), 16 * 6, std::uint8_t(255));  // the upper half
    for (int i = 0; i < 12 * 16; ++i) stored_mask.u8.push_back(i % 12 < 6 ? 255 : 0);
    write_image(folder_ / "masks/a.jpg.png", upright_mask);
    write_image(folder_ / "masks/b.jpg.png", stored_mask);
    const Scene scene = load(12, 16, 6);
    for (const View& view : scene.train) {
        const ViewImage image = view.load();
        ASSERT_TRUE(image.mask);
        EXPECT_EQ(image.mask->value(8, 2, 0), 1) << view.name;
        EXPECT_EQ(image.mask->value(8, 9, 0), 0) << view.name;
    }
}

TEST_F(TaggedScene, ImagesWithoutAnOrientationAreReadAsBefore) {
    const Scene scene = load(12, 16, 1);
    EXPECT_TRUE(mentions(scene.notes, "differ in size"));
    EXPECT_FALSE(mentions(scene.notes, "EXIF"));
    EXPECT_EQ(scene.train[0].camera.width, 12);
}

TEST_F(TaggedScene, TransformsFilesAsWell) {
    write_tagged(folder_ / "images/a.jpg", 12, 16, 6);
    spit(folder_ / "transforms.json",
         R"({"fl_x": 20, "w": 16, "h": 12, "frames": [{"file_path": "images/a.jpg",
             "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]})");
    SceneOptions options;
    options.source = folder_.path().string();
    const Scene scene = load_scene(options);
    EXPECT_TRUE(mentions(scene.notes, "1 images are turned by their EXIF orientation"));
    EXPECT_EQ(scene.train[0].load().color.width, 16);
}

}  // namespace
}  // namespace gs::test
