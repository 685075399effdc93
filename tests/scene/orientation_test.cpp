// SPDX-License-Identifier: Apache-2.0
// Scenes whose photographs carry an EXIF orientation: the sizes of the cameras say whether it counts.
#include "lib/scene/scene.h"
#include "tests/io/tagged_image.h"
#include "tests/scene/scene_fixture.h"

namespace gs::test {
namespace {

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
