// SPDX-License-Identifier: Apache-2.0
// Whole scenes: image folders, sizes, splits, masks, pre-flight notes, extent.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>

#include "kernels/base/error.h"
#include "lib/scene/scene.h"
#include "tests/core/unprivileged.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;

TEST(LoadScene, ColmapSceneIsSortedByNameAndLoads) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"sub/b c.png", "a.png", "Z.png"});
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.kind, "colmap");
    EXPECT_EQ(scene.image_folder, "images");
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"Z.png", "a.png", "sub/b c.png"}));
    EXPECT_TRUE(scene.test.empty());
    EXPECT_EQ(scene.points.positions.size(), 3u);
    EXPECT_TRUE(scene.notes.empty()) << scene.notes[0];
    EXPECT_FALSE(scene.has_alpha);
    EXPECT_EQ(scene.random_init_half_extent, 0);
    const ViewImage image = scene.train[0].load();
    EXPECT_EQ(image.color.u8, gradient_image(16, 12).u8);
    EXPECT_FALSE(image.mask);
    EXPECT_EQ(scene.train[0].image_bytes, 16u * 12 * 3);
    EXPECT_EQ(scene.train[1].camera.fx, 20);
    EXPECT_NEAR(scene.train[1].camera.center().x(), -0.1, 1e-12);
}

TEST(LoadScene, EveryNthOfTheSortedListIsTest) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(10));
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(names_of(scene.test), (std::vector<std::string>{"a.png", "i.png"}));
    EXPECT_EQ(scene.train.size(), 8u);
    EXPECT_NE(scene.split_rule.find("index % 8 == 0"), std::string::npos);
    SceneOptions options = at(folder.path(), true);
    options.test_every = 3;
    EXPECT_EQ(names_of(load_unframed(options).test), (std::vector<std::string>{"a.png", "d.png", "g.png", "j.png"}));
    options.test_every = 0;
    EXPECT_TRUE(load_unframed(options).test.empty());
}

TEST(LoadScene, TestListOverridesTheRule) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(4));
    spit(folder / "list.txt", "# held out\nb.png\r\n\nd\n");
    SceneOptions options = at(folder.path(), true);
    options.test_list = (folder / "list.txt").string();
    EXPECT_EQ(names_of(load_unframed(options).test), (std::vector<std::string>{"b.png", "d.png"}));
    options.eval = false;
    EXPECT_TRUE(mentions(load_unframed(options).notes, "test list without --eval"));
    options.eval = true;
    spit(folder / "list.txt", "b.png\nx.png\n");
    EXPECT_CONTAINS(error_of(options), "list.txt: line 2: no image is named 'x.png'");
    options.test_list = "no/such/file";
    EXPECT_CONTAINS(error_of(options), "cannot be read: No such file");
}

TEST(LoadScene, NamesInATestListMayDifferInFoldersAndCase) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"left/a.png", "left/b.png", "right/b.png", "c.png"});
    SceneOptions options = at(folder.path(), true);
    options.test_list = (folder / "list.txt").string();
    spit(folder / "list.txt", "/data/images/left/b.PNG\nimages/c.png\n");
    EXPECT_EQ(names_of(load_unframed(options).test), (std::vector<std::string>{"c.png", "left/b.png"}));
    spit(folder / "list.txt", "b.png\n");
    EXPECT_CONTAINS(error_of(options), "list.txt: line 1: several images could be 'b.png'");
}

TEST(LoadScene, TestListMayBeginWithAByteOrderMark) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(4));
    spit(folder / "list.txt",
         "\xef\xbb\xbf"
         "b.png\r\nd.png");
    SceneOptions options = at(folder.path(), true);
    options.test_list = (folder / "list.txt").string();
    EXPECT_EQ(names_of(load_unframed(options).test), (std::vector<std::string>{"b.png", "d.png"}));
    options.test_list = "/dev/zero";
    EXPECT_CONTAINS(error_of(options), "test list /dev/zero: cannot be read: it is a device");
}

TEST(LoadScene, PipesInPlaceOfImagesMasksAndModelsAreNamed) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));
    const auto make_pipe = [&](const std::string& name) {
        std::filesystem::remove(folder / name);
        ASSERT_EQ(::mkfifo((folder / name).c_str(), 0666), 0);
    };
    make_pipe("images/a.png");
    EXPECT_TRUE(mentions(load_unframed(at(folder.path())).notes, "a.png: it is a named pipe"));
    std::filesystem::create_directory(folder / "masks");
    make_pipe("masks/b.png");
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_CONTAINS(message_of<DataError>([&] { scene.train[0].load(); }), "masks/b.png: it is a named pipe");
    make_pipe("sparse/0/cameras.bin");
    EXPECT_CONTAINS(error_of(at(folder.path())), "cameras.bin: cannot be read: it is a named pipe");
}

TEST(LoadScene, WhatMayNotBeReadIsSaidToBe) {
    namespace fs = std::filesystem;
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));
    fs::permissions(folder.path(), fs::perms(0755));
    const auto error_without = [&](const std::string& name) {
        const fs::path path = name.empty() ? folder.path() : folder / name;
        fs::permissions(path, fs::perms::none);
        std::string error;
        {
            const Unprivileged nobody;
            error = nobody.bound() ? error_of(at(folder.path())) : "skipped";
        }
        fs::permissions(path, fs::perms(0755));
        return error;
    };
    const std::string error = error_without("images");
    if (error == "skipped") GTEST_SKIP() << "root is bound by no permissions";
    EXPECT_CONTAINS(error, "images: cannot be listed: Permission denied");
    EXPECT_CONTAINS(error_without(""), "Permission denied");
    EXPECT_CONTAINS(error_without("sparse"), "sparse: cannot be listed: Permission denied");
    EXPECT_CONTAINS(error_without("sparse/0/images.bin"), "images.bin: cannot be read: Permission denied");
}

TEST(LoadScene, FolderNamesMayHoldPatterns) {
    TempFolder folder;
    write_colmap_scene(folder / "scene", numbered(2));
    std::filesystem::rename(folder / "scene", folder / "*?[a]");
    const Scene scene = load_unframed(at(folder / "*?[a]"));
    EXPECT_EQ(scene.train.size(), 2u);
    EXPECT_EQ(scene.train[0].load().color.u8, gradient_image(16, 12).u8);
}

TEST(LoadScene, OneImageIsNeverHeldOut) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(scene.train.size(), 1u);
    EXPECT_TRUE(scene.test.empty());
    EXPECT_GT(scene.extent, 0) << "one camera has no spread, but its scene has a size";
}

TEST(LoadScene, IntrinsicsFollowTheActualSizePerAxis) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    write_png(folder / "images/a.png", 8, 3);
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.train[0].camera.width, 8);
    EXPECT_EQ(scene.train[0].camera.fx, 10);
    EXPECT_EQ(scene.train[0].camera.fy, 5);
    EXPECT_EQ(scene.train[0].camera.cx, 4);
    EXPECT_EQ(scene.train[0].camera.cy, 1.5);
    EXPECT_EQ(scene.train[1].camera.fx, 20);
    EXPECT_TRUE(mentions(scene.notes, "1 images differ in size from their camera"));
    EXPECT_TRUE(mentions(scene.notes, "a.png is 8x3, its camera 16x12"));
}

TEST(LoadScene, PreScaledFolderIsPreferredToResizing) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    SceneOptions options = at(folder.path());
    options.resolution = 2;
    const Scene resized = load_unframed(options);
    EXPECT_EQ(resized.image_folder, "images");
    EXPECT_EQ(resized.train[0].camera.width, 8);
    EXPECT_EQ(resized.train[0].camera.height, 6);
    EXPECT_EQ(resized.train[0].camera.fx, 10);
    EXPECT_EQ(resized.train[0].load().color.u8, resize_image(gradient_image(16, 12), 8, 6).u8);
    EXPECT_TRUE(mentions(resized.facts, "box filter"));
    EXPECT_FALSE(mentions(resized.notes, "box filter")) << "no warning of what was asked for";

    // Sizes as published rarely divide evenly, extensions may differ.
    write_png(folder / "images_2/a.tif", 7, 6);
    write_png(folder / "images_2/b.png", 7, 6);
    const Scene scaled = load_unframed(options);
    EXPECT_EQ(scaled.image_folder, "images_2");
    EXPECT_EQ(scaled.train[0].name, "a.png");
    EXPECT_EQ(scaled.train[0].camera.width, 7);
    EXPECT_DOUBLE_EQ(scaled.train[0].camera.fx, 20 * 7 / 16.0);
    EXPECT_EQ(scaled.train[0].load().color.u8, gradient_image(7, 6).u8);
    EXPECT_TRUE(mentions(scaled.notes, "images_2"));
}

TEST(LoadScene, RenumberedPreScaledFilesArePairedByOrder) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"IMG_7.png", "IMG_9.png"});
    write_png(folder / "images_4/frame_0.png", 4, 3);
    write_png(folder / "images_4/frame_1.png", 4, 3);
    SceneOptions options = at(folder.path());
    options.resolution = 4;
    EXPECT_EQ(names_of(load_unframed(options).train), (std::vector<std::string>{"IMG_7.png", "IMG_9.png"}));
    write_png(folder / "images_4/frame_2.png", 4, 3);
    EXPECT_CONTAINS(error_of(options), "2 images missing");
}

TEST(LoadScene, APreScaledFolderTakesThePlaceOfFullSizeImages) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    std::filesystem::remove_all(folder / "images");
    for (const char* name : {"images_4/a.png", "images_4/b.png"}) write_png(folder / name, 4, 3);
    write_png(folder / "images_8/a.png", 2, 2);
    SceneOptions options = at(folder.path());
    const Scene scene = load_unframed(options);
    EXPECT_EQ(scene.image_folder, "images_4");
    EXPECT_TRUE(mentions(scene.facts, "images: images_4, because there is no folder 'images'"));
    EXPECT_EQ(scene.train[0].camera.width, 4);
    EXPECT_DOUBLE_EQ(scene.train[0].camera.fx, 5);
    options.resolution = 4;
    EXPECT_EQ(load_unframed(options).train[0].camera.width, 4);
    options.resolution = 2;  // of 16 pixels, not of the 4 that there are
    EXPECT_CONTAINS(error_of(options), "there are images_4, images_8: take --images images_4");
}

TEST(LoadScene, WidthRuleAndCap) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    write_png(folder / "images/a.png", 3200, 20);
    SceneOptions options = at(folder.path());
    Scene scene = load_unframed(options);
    EXPECT_EQ(scene.train[0].camera.width, 1600);
    EXPECT_EQ(scene.train[0].camera.height, 10);
    EXPECT_EQ(scene.train[0].load().color.width, 1600);
    EXPECT_TRUE(mentions(scene.notes, "wider than 1600 px"));
    EXPECT_FALSE(mentions(scene.facts, "box filter")) << "said once";
    options.resolution = 1;
    EXPECT_EQ(load_unframed(options).train[0].camera.width, 3200);
    options.resolution = 100;
    EXPECT_EQ(load_unframed(options).train[0].camera.width, 100);
    options.resolution = 4000;
    scene = load_unframed(options);
    EXPECT_EQ(scene.train[0].camera.width, 3200);
    EXPECT_TRUE(mentions(scene.notes, "not enlarged"));
    for (const int bad : {0, -2, 3, 15}) {
        options.resolution = bad;
        EXPECT_THROW(load_unframed(options), UsageError) << bad;
    }
}

TEST(LoadScene, DistortedCamerasAreUndistortedOnce) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    spit(folder / "sparse/0/cameras.bin", cameras_bin({{1, 4, 16, 12, {20, 20, 8, 6, -0.1, 0, 0, 0}}}));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(mentions(scene.notes, "2 images with lens distortion (OPENCV)"));
    const ViewImage image = scene.train[0].load();
    EXPECT_EQ(image.color.width, scene.train[0].camera.width);
    EXPECT_EQ(image.color.height, scene.train[0].camera.height);
    EXPECT_NEAR(image.color.width, 16, 1);
}

TEST(LoadScene, MissingUnreadableAndDoubleImagesAreNoted) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png", "c.png", "d.png"});
    auto images = row_of_images({"a.png", "b.png", "c.png", "d.png"});
    images.push_back({9, {1, 0, 0, 0, 0, 0, 4}, 1, "d.png"});
    spit(folder / "sparse/0/images.bin", images_bin(images));
    std::filesystem::remove(folder / "images/a.png");
    spit(folder / "images/b.png", "");
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"c.png", "d.png"}));
    EXPECT_TRUE(mentions(scene.notes, "1 images missing: skipped (a.png)"));
    EXPECT_TRUE(mentions(scene.notes, "1 images unreadable: skipped"));
    EXPECT_TRUE(mentions(scene.notes, "1 image names appear more than once"));
    std::filesystem::remove(folder / "images/c.png");
    std::filesystem::remove(folder / "images/d.png");
    EXPECT_CONTAINS(error_of(at(folder.path())), "no usable image");
    std::filesystem::remove_all(folder / "images");
    EXPECT_CONTAINS(error_of(at(folder.path())), "image folder 'images' does not exist");
}

TEST(LoadScene, PointsThatNobodySeesAndNoPointsAreNoted) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    spit(folder / "sparse/0/points3D.bin", points_bin({{1, 0, 0, 0}, {2, 0, 0, -9}, {3, 50, 0, 0}}));
    EXPECT_TRUE(mentions(load_unframed(at(folder.path())).notes, "2 of 3 points project into no image"));
    std::vector<TestPoint> many;
    for (int i = 1; i <= 40; ++i) many.push_back({std::uint64_t(i), 0, 0, i <= 2 ? -9.0 : 0.0});
    spit(folder / "sparse/0/points3D.bin", points_bin(many));
    const Scene few = load_unframed(at(folder.path()));
    EXPECT_FALSE(mentions(few.notes, "project into no image")) << "5 % are usual, and no warning";
    many[2].z = -9;
    spit(folder / "sparse/0/points3D.bin", points_bin(many));
    EXPECT_TRUE(mentions(load_unframed(at(folder.path())).notes, "3 of 40 points project into no image"));
    spit(folder / "sparse/0/points3D.bin", points_bin({{2, 0, 0, -9}}));
    EXPECT_TRUE(mentions(load_unframed(at(folder.path())).notes, "none of the 1 points"));
    spit(folder / "sparse/0/points3D.bin", points_bin({}));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(scene.points.positions.empty());
    EXPECT_TRUE(mentions(scene.notes, "no points: random initialisation"));
}

TEST(LoadScene, PlyPointsReplaceAMissingPointFile) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    std::filesystem::remove(folder / "sparse/0/points3D.bin");
    Bytes rows;
    for (const float v : {0.5f, 0.25f, 0.0f}) rows.put(v);
    for (const int v : {255, 0, 51}) rows.put(std::uint8_t(v));
    spit(
        folder / "sparse/0/points3D.ply",
        "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n" +
            rows.data());
    const Scene scene = load_unframed(at(folder.path()));
    ASSERT_EQ(scene.points.positions.size(), 1u);
    EXPECT_EQ(scene.points.positions[0], Eigen::Vector3f(0.5f, 0.25f, 0));
    EXPECT_FLOAT_EQ(scene.points.colors[0][2], 0.2f);
}

TEST(LoadScene, MasksBecomeWeightsOrAlpha) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    std::filesystem::create_directories(folder / "masks");
    write_image(folder / "masks/a.png.png", Image{16, 12, 3, std::vector<std::uint8_t>(16 * 12 * 3, 255), {}});
    SceneOptions options = at(folder.path());
    Scene scene = load_unframed(options);
    EXPECT_TRUE(mentions(scene.notes, "1 of 2 images have no mask"));
    EXPECT_TRUE(mentions(scene.facts, "masks: 1 of 2 images have one"));
    EXPECT_TRUE(mentions(scene.facts, (folder / "masks/a.png.png").string()));
    ASSERT_TRUE(scene.train[0].load().mask);
    EXPECT_EQ(scene.train[0].load().mask->u8[5], 255);
    EXPECT_EQ(scene.train[0].image_bytes, 16u * 12 * 4);
    EXPECT_FALSE(scene.train[1].load().mask);
    options.invert_masks = true;
    EXPECT_EQ(load_unframed(options).train[0].load().mask->u8[5], 0);
    options.mask_mode = MaskMode::kTransparent;
    scene = load_unframed(options);
    EXPECT_TRUE(scene.has_alpha);
    EXPECT_EQ(scene.train[0].load().color.channels, 4);
    EXPECT_EQ(scene.train[0].load().color.u8[3], 0);
}

TEST(LoadScene, RgbaPhotographsFollowTheAlphaMode) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    write_png(folder / "images/a.png", 16, 12, 4);
    SceneOptions options = at(folder.path());
    EXPECT_TRUE(load_unframed(options).has_alpha);
    EXPECT_EQ(load_unframed(options).train[0].load().color.channels, 4);
    options.alpha_mode = AlphaMode::kMask;
    const Scene scene = load_unframed(options);
    EXPECT_FALSE(scene.has_alpha);
    EXPECT_TRUE(scene.train[0].load().mask);
    EXPECT_EQ(scene.train[0].load().color.bytes() + 16 * 12, scene.train[0].image_bytes);
}

void write_nerf_synthetic(const TempFolder& folder) {
    spit(folder / "transforms_train.json",
         "{\"camera_angle_x\": 0.8, \"frames\": [" + frame("./train/r_1") + "," + frame("./train/r_0", 1) + "]}");
    spit(folder / "transforms_test.json", "{\"camera_angle_x\": 0.8, \"frames\": [" + frame("./test/r_0", 2) + "]}");
    for (const char* name : {"train/r_0.png", "train/r_1.png", "test/r_0.png"}) write_png(folder / name, 16, 12, 4);
}

TEST(LoadScene, NerfSyntheticKeepsItsSplitAndOrder) {
    TempFolder folder;
    write_nerf_synthetic(folder);
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(scene.kind, "nerf-synthetic");
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"train/r_1.png", "train/r_0.png"}));
    EXPECT_EQ(names_of(scene.test), (std::vector<std::string>{"test/r_0.png"}));
    EXPECT_TRUE(scene.has_alpha);
    EXPECT_EQ(scene.random_init_half_extent, 1.5);
    EXPECT_TRUE(scene.points.positions.empty());
    EXPECT_NEAR(scene.train[0].camera.fx, 8 / std::tan(0.4), 1e-9);
    EXPECT_NEAR(scene.extent, 1.1 * 0.5, 1e-9);
    const Scene merged = load_unframed(at(folder.path(), false));
    EXPECT_EQ(merged.train.size(), 3u);
    EXPECT_TRUE(merged.test.empty());
    EXPECT_NE(merged.split_rule.find("train as well"), std::string::npos);
}

TEST(LoadScene, TransformsFileIsSortedSplitAndScaled) {
    TempFolder folder;
    spit(folder / "transforms.json", "{\"fl_x\": 40, \"w\": 32, \"h\": 24, \"frames\": [" + frame("images/c.png") +
                                         "," + frame("images/a") + "," + frame("images/b.png", 3) + "]}");
    for (const char* name : {"a.jpg", "b.png", "c.png"}) write_png(folder / "images" / name);
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(scene.kind, "transforms");
    EXPECT_EQ(names_of(scene.test), (std::vector<std::string>{"images/a.jpg"}));
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"images/b.png", "images/c.png"}));
    EXPECT_EQ(scene.train[0].camera.fx, 20) << "half the size that the file states";
    EXPECT_EQ(scene.train[0].camera.cx, 8);
    const Scene by_file = load_unframed(at(folder / "transforms.json", true));
    EXPECT_EQ(names_of(by_file.train), names_of(scene.train));
}

TEST(LoadScene, TransformsFindAnImageWhoseNameIsTooLongWithAnotherExtension) {
    TempFolder folder;
    const std::string stem(251, 'a');  // with ".jpeg" 256 bytes, one more than file systems take
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"frames\": [" + frame("images/" + stem) + "]}");
    write_png(folder / "images/short.tif");  // its temporary file has a longer name
    std::filesystem::rename(folder / "images/short.tif", folder / "images" / (stem + ".tif"));
    EXPECT_EQ(names_of(load_unframed(at(folder.path(), false)).train),
              (std::vector<std::string>{"images/" + stem + ".tif"}));
}

TEST(LoadScene, TransformsWithExplicitSplit) {
    TempFolder folder;
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"test_filenames\": [\"images/b.png\"], \"frames\": [" +
                                         frame("images/a.png") + "," + frame("images/b.png") + "]}");
    for (const char* name : {"a.png", "b.png"}) write_png(folder / "images" / name);
    const Scene scene = load_unframed(at(folder.path(), true));
    EXPECT_EQ(names_of(scene.test), (std::vector<std::string>{"images/b.png"}));
    EXPECT_NE(scene.split_rule.find("test_filenames"), std::string::npos);
}

TEST(LoadScene, MasksOfATransformsFileAreStatedOrFoundByName) {
    TempFolder folder;
    const std::vector<std::string> names{"images/front/a.png", "images/front/b.png", "images/back/a.png"};
    write_transforms_scene(folder.path(), names);
    write_png(folder / "masks/front/a.jpg");
    Scene scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(mentions(scene.facts,
                         "masks: 1 of 3 images have one, the first is " + (folder / "masks/front/a.jpg").string()));
    EXPECT_TRUE(mentions(scene.notes, "2 of 3 images have no mask: used whole"));
    spit(folder / "transforms.json", "{\"fl_x\": 20, \"frames\": [" +
                                         frame(names[0], 0, ", \"mask_path\": \"gone/a.png\"") + "," +
                                         frame(names[1], 1, ", \"mask_path\": \"gone/b.png\"") + "," +
                                         frame(names[2], 2, ", \"mask_path\": null") + "]}");
    scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(mentions(scene.notes,
                         "2 of 2 files that mask_path names do not exist (gone/a.png, gone/b.png); "
                         "1 masks are found by the image's name"));
    EXPECT_TRUE(mentions(scene.facts, "masks: 1 of 3 images have one"));
    std::filesystem::remove_all(folder / "masks");
    scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(mentions(scene.notes, "(gone/a.png, gone/b.png): their images are used whole"));
    EXPECT_FALSE(mentions(scene.facts, "masks:"));
    EXPECT_EQ(scene.train.size(), 3u);
    EXPECT_FALSE(scene.train[0].load().mask);
}

TEST(LoadScene, MasksAreFoundByTheFilesOfImagesHoweverTheDatasetSpellsThem) {
    TempFolder folder;
    const std::string composed = "K\xC3\xBC.png", decomposed = "Ku\xCC\x88.png";
    write_model(folder / "sparse/0", {TestCamera{}}, row_of_images({"C:\\shoot\\Left\\A.JPG", composed}), {});
    write_png(folder / "images/left/a.png");
    write_png(folder / "images" / decomposed);
    write_png(folder / "masks/left/a.png");
    write_png(folder / "masks" / composed);
    const Scene scene = load_unframed(at(folder.path()));
    ASSERT_EQ(scene.train.size(), 2u);
    EXPECT_TRUE(scene.train[0].load().mask);
    EXPECT_TRUE(scene.train[1].load().mask);
}

TEST(LoadScene, MasksBesidePhotographsAreNotTakenForThem) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "a.png.mask.png", "b.png"});
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"a.png", "b.png"}));
    EXPECT_TRUE(scene.train[0].load().mask);
    EXPECT_TRUE(mentions(scene.notes, "1 images are masks of others by their names"));
    // The pre-scaled folder has other names and no masks.
    write_png(folder / "images_2/0.png", 8, 6);
    write_png(folder / "images_2/1.png", 8, 6);
    SceneOptions options = at(folder.path());
    options.resolution = 2;
    EXPECT_EQ(names_of(load_unframed(options).train), (std::vector<std::string>{"a.png", "b.png"}));
}

TEST(LoadScene, MasksWhoseNamesFitNoImageAreNoted) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    write_png(folder / "masks/0001.png");
    EXPECT_TRUE(mentions(load_unframed(at(folder.path())).notes,
                         (folder / "masks").string() + ": its files have the name of no image"));
}

TEST(LoadScene, MasksOfAnotherShapeAreNoted) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png", "b.png"});
    write_png(folder / "masks/a.png", 8, 6);
    write_png(folder / "masks/b.png", 8, 12);
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_TRUE(mentions(scene.notes, "1 masks have another shape than their images: stretched"));
    EXPECT_TRUE(mentions(scene.notes, "masks/b.png is 8x12, b.png 16x12"));
    EXPECT_EQ(scene.train[0].load().mask->width, 16);
}

TEST(LoadScene, OpaquePhotographsWithAlphaKeepTheirMasks) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    write_png(folder / "images/a.png", 16, 12, 4);
    std::filesystem::create_directories(folder / "masks");
    write_image(folder / "masks/a.png", Image{16, 12, 3, std::vector<std::uint8_t>(16 * 12 * 3, 255), {}});
    SceneOptions options = at(folder.path());
    for (const AlphaMode mode : {AlphaMode::kTransparent, AlphaMode::kMask}) {
        options.alpha_mode = mode;
        const ViewImage image = load_unframed(options).train[0].load();
        ASSERT_TRUE(image.mask);
        EXPECT_EQ(image.mask->u8[0], 255);
    }
}

TEST(LoadScene, AnImageFolderThatDoesNotExistIsRefusedForEveryKindOfScene) {
    TempFolder colmap, synthetic, transforms;
    write_colmap_scene(colmap.path(), {"a.png"});
    write_png(colmap / "images_4/a.png", 4, 3);
    write_nerf_synthetic(synthetic);
    write_transforms_scene(transforms.path(), {"images/a.png"});
    const auto error_with = [](const std::filesystem::path& source) {
        SceneOptions options = at(source);
        options.images = "pictures";
        return error_of(options);
    };
    EXPECT_CONTAINS(error_with(colmap.path()),
                    "image folder 'pictures' does not exist; folders with images are images, images_4");
    EXPECT_CONTAINS(error_with(synthetic.path()), "'pictures' does not exist; folders with images are test, train");
    EXPECT_CONTAINS(error_with(transforms / "transforms.json"), "folders with images are images");
    // Configurations of photographed scenes name a folder, and serve built-in ones as well.
    SceneOptions options = at("builtin:diffuse");
    options.images = "pictures";
    EXPECT_TRUE(mentions(load_unframed(options).notes, "--images pictures is not used"));
}

TEST(LoadScene, AnotherImageFolderCountsForTransformsToo) {
    TempFolder folder;
    write_transforms_scene(folder.path(), {"images/left/a.png", "images/b.png"});
    write_png(folder / "images_2/left/a.png", 8, 6);
    write_png(folder / "images_2/b.png", 8, 6);
    SceneOptions options = at(folder.path());
    options.images = "images_2";
    const Scene scene = load_unframed(options);
    EXPECT_EQ(scene.image_folder, "images_2");
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"images/b.png", "images/left/a.png"}));
    EXPECT_EQ(scene.train[1].camera.width, 8);
}

TEST(LoadScene, AnotherImageFolderOfTransformsHoldsFilesHoweverNamesAreSpelled) {
    TempFolder folder;
    write_transforms_scene(folder.path(), {"images/a.png", "images/b.png", "images/left/c.png"});
    write_png(folder / "small/A.png", 8, 6);
    write_png(folder / "small/b.png", 8, 6);
    std::filesystem::rename(folder / "small/b.png", folder / "small/b.jpg");
    write_png(folder / "small/left/c.png", 8, 6);
    SceneOptions options = at(folder.path());
    options.images = "small";
    Scene scene = load_unframed(options);
    ASSERT_EQ(scene.train.size(), 3u);
    for (const View& view : scene.train) EXPECT_EQ(view.camera.width, 8);
    EXPECT_FALSE(mentions(scene.notes, "another place")) << "the folder was asked for";
    // Absolute names do not lead back to the files that they are of.
    spit(folder / "transforms.json",
         "{\"fl_x\": 20, \"frames\": [" + frame((folder / "images/left/c.png").string()) + "]}");
    scene = load_unframed(options);
    ASSERT_EQ(scene.train.size(), 1u);
    EXPECT_EQ(scene.train[0].camera.width, 8);
}

TEST(LoadScene, UnknownSourcesAreErrorsWithAHint) {
    TempFolder folder;
    EXPECT_CONTAINS(error_of(at(folder / "nowhere")), "no such folder or file");
    EXPECT_CONTAINS(error_of(at(folder.path())), "not a scene");
}

TEST(LoadScene, AListWithoutImagesIsNamed) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    spit(folder / "sparse/0/images.bin", images_bin({}));
    EXPECT_CONTAINS(error_of(at(folder.path())), "sparse/0/images.bin with images of");
}

TEST(LoadScene, TheMissingHalfOfAColmapModelIsNamed) {
    for (const char* missing : {"cameras.bin", "images.bin"}) {
        TempFolder folder;
        write_colmap_scene(folder.path(), {"a.png"});
        std::filesystem::remove(folder / (std::string("sparse/0/") + missing));
        EXPECT_CONTAINS(error_of(at(folder.path())), std::string("sparse/0/") + missing + ": is missing");
    }
}

TEST(LoadScene, ImageThatChangesAfterwardsIsAnError) {
    TempFolder folder;
    write_colmap_scene(folder.path(), {"a.png"});
    const Scene scene = load_unframed(at(folder.path()));
    write_png(folder / "images/a.png", 20, 12);
    EXPECT_CONTAINS(message_of<DataError>([&] { scene.train[0].load(); }), "is 20x12 now");
}

TEST(CameraExtent, IsElevenTenthsOfTheLargestDistance) {
    std::vector<View> views(2);
    views[1].camera.translation = {0, 0, -4};
    EXPECT_NEAR(camera_extent(views, {}), 2.2, 1e-12);
    PointCloud points;
    points.positions = {{30, 40, 0}};
    EXPECT_NEAR(camera_extent({views[0]}, points), 0.5, 1e-6) << "one camera: a hundredth of the scene box";
    EXPECT_EQ(camera_extent({views[0]}, {}), 1e-6);
    EXPECT_GT(camera_extent({}, {}), 0);
}

/// Loads a scene of images a.png, b.png, ... whose cameras have the given ids.
Scene scene_with_cameras(const std::vector<std::uint32_t>& ids, bool eval) {
    TempFolder folder;
    const auto names = numbered(int(ids.size()));
    auto images = row_of_images(names);
    std::vector<TestCamera> cameras;
    for (std::size_t i = 0; i < ids.size(); ++i) {
        images[i].camera_id = ids[i];
        if (std::none_of(cameras.begin(), cameras.end(), [&](const TestCamera& c) { return c.id == ids[i]; }))
            cameras.push_back({.id = ids[i]});
        write_png(folder.path() / "images" / names[i]);
    }
    write_model(folder.path() / "sparse/0", cameras, images, {{1, 0, 0, 0, 255, 128, 0, 2}});
    return load_unframed(at(folder.path(), eval));
}

TEST(LoadScene, CamerasAreNumberedByTheirIds) {
    const Scene scene = scene_with_cameras({9, 4, 9, 4}, false);
    EXPECT_EQ(scene.num_cameras, 2);
    for (int i = 0; i < 4; ++i) EXPECT_EQ(scene.train[std::size_t(i)].camera_id, 1 - i % 2);
}

TEST(LoadScene, ACameraWithoutTrainingImagesIsUnknown) {
    const Scene scene = scene_with_cameras({9, 4, 4}, true);  // the first is the test view
    EXPECT_EQ(scene.num_cameras, 1);
    EXPECT_EQ(scene.train[0].camera_id, 0);
    EXPECT_EQ(scene.test[0].camera_id, -1);
}

TEST(LoadScene, ACameraForEveryImageIsOneDevice) {
    const Scene scene = scene_with_cameras({1, 2, 3, 4}, true);
    EXPECT_EQ(scene.num_cameras, 1);
    EXPECT_EQ(scene.train[2].camera_id, 0);
    EXPECT_EQ(scene.test[0].camera_id, 0);
}

TEST(LoadScene, ALensThatFoldsLeavesOutItsImagesAlone) {
    TempFolder folder;
    auto images = row_of_images(numbered(4));
    images[1].camera_id = 2;
    for (const TestImage& image : images) write_png(folder / "images" / image.name);
    write_model(folder / "sparse/0", {TestCamera{}, {2, 2, 16, 12, {10, 8, 6, -1.5}}}, images, {TestPoint{}});
    SceneOptions options = at(folder.path());
    options.lens = LensMode::kUndistort;
    const Scene scene = load_unframed(options);
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"a.png", "c.png", "d.png"}));
    EXPECT_TRUE(
        mentions(scene.notes, "1 images are left out because their camera cannot be used (first: image 'b.png'"));
    for (TestImage& image : images) image.camera_id = 2;
    spit(folder / "sparse/0/images.bin", images_bin(images));
    EXPECT_CONTAINS(error_of(options), "image 'a.png'");
}

TEST(LoadScene, ALensThatFoldsIsUsedInTheCircleWhereItDoesNot) {
    TempFolder folder;
    auto images = row_of_images(numbered(4));
    images[1].camera_id = 2;
    for (const TestImage& image : images) write_png(folder / "images" / image.name);
    write_model(folder / "sparse/0", {TestCamera{}, {2, 2, 16, 12, {10, 8, 6, -1.5}}}, images, {TestPoint{}});
    const Scene scene = load_unframed(at(folder.path()));
    ASSERT_EQ(names_of(scene.train), (std::vector<std::string>{"a.png", "b.png", "c.png", "d.png"}));
    const View &pinhole = scene.train[0], &native = scene.train[1];
    EXPECT_TRUE(is_pinhole(pinhole.camera));
    EXPECT_FALSE(pinhole.lens_weights);
    EXPECT_EQ(native.camera.model, CameraModel::kSimpleRadial);
    // r (1 - 1.5 r^2) turns back at r = 0.471. It is used while (1 - 4.5 r^2)(1 + r^2) >= 0.4: to r = 0.3802, which is
    // 2.978 pixels from the centre.
    EXPECT_TRUE(native.camera.range.folds);
    EXPECT_NEAR(std::tan(native.camera.range.max_angle), std::sqrt((-3.5 + std::sqrt(3.5 * 3.5 + 4 * 4.5 * 0.6)) / 9),
                1e-5);
    ASSERT_TRUE(native.lens_weights);
    const ViewImage image = native.load();
    for (int y = 0; y < 12; ++y)
        for (int x = 0; x < 16; ++x) {
            const bool inside = std::hypot(x + 0.5 - 8, y + 0.5 - 6) < 2.978;
            EXPECT_EQ(native.lens_weights->u8[std::size_t(y) * 16 + x], inside ? 255 : 0) << x << ", " << y;
            EXPECT_EQ(image.mask->u8[std::size_t(y) * 16 + x], inside ? 255 : 0);
            EXPECT_TRUE(inside || image.color.value(x, y, 0) == 0);
        }
    EXPECT_TRUE(mentions(scene.notes, "1 images are used only in part (17 % at least)"));
}

TEST(LoadScene, LensesAreUndistortedUnlessThereIsNoPinholeImage) {
    TempFolder folder;
    const auto images = row_of_images(numbered(3));
    for (const TestImage& image : images) write_png(folder / "images" / image.name);
    const auto camera = [&](double k1, LensMode mode) {
        write_model(folder / "sparse/0", {{1, 2, 16, 12, {10, 8, 6, k1}}}, images, {TestPoint{}});
        SceneOptions options = at(folder.path());
        options.lens = mode;
        return load_unframed(options).train.front().camera;
    };
    EXPECT_TRUE(is_pinhole(camera(-0.05, LensMode::kAuto)));
    EXPECT_FALSE(is_pinhole(camera(-1.5, LensMode::kAuto))) << "it folds";
    EXPECT_TRUE(is_pinhole(camera(-0.05, LensMode::kUndistort)));
    EXPECT_FALSE(is_pinhole(camera(-0.001, LensMode::kNative)));
    const Camera native = camera(-0.05, LensMode::kNative);
    EXPECT_EQ(native.width, 16) << "the photograph's own pixels";
    EXPECT_EQ(native.fx, 10);
}

TEST(LoadScene, AFrameThatCannotBeUsedIsLeftOutAlone) {
    TempFolder folder;
    for (const char* name : {"a.png", "b.png", "c.png", "d.png"}) write_png(folder / "images" / name);
    const std::string good = "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    const std::string bad = "\"transform_matrix\": [[NaN,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
    spit(folder / "transforms.json", R"({"fl_x": 20, "frames": [{"file_path": "images/a.png", )" + good +
                                         R"(}, {"file_path": "images/b.png", )" + bad +
                                         R"(}, {"file_path": "images/c.png", "fl_x": NaN, )" + good +
                                         R"(}, {"file_path": "C:\\shoot\\d.png", )" + good + "}]}");
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(names_of(scene.train), (std::vector<std::string>{"C:/shoot/d.png", "images/a.png"}));
    EXPECT_TRUE(mentions(scene.notes, "2 of 4 frames are left out because they cannot be used (first: "));
    EXPECT_TRUE(mentions(scene.notes, "frame 1: key 'transform_matrix' must be"));
    EXPECT_TRUE(mentions(scene.notes, "found by the end of the name (first: 'C:/shoot/d.png' is images/d.png)"));
}

TEST(LoadScene, ACameraFarOutsideOfTheOthersDoesNotSetTheSize) {
    TempFolder folder;
    const auto names = numbered(12);
    write_colmap_scene(folder.path(), names);
    const double extent = load_unframed(at(folder.path())).extent;
    const auto load = [&](int axis, std::vector<double> distances) {
        auto images = row_of_images(names);
        for (std::size_t i = 0; i < distances.size(); ++i) images[i].pose[4 + axis] = distances[i];
        spit(folder / "sparse/0/images.bin", images_bin(images));
        return load_unframed(at(folder.path()));
    };
    EXPECT_FALSE(mentions(load(0, {}).notes, "far outside of the others")) << "a straight line";
    EXPECT_FALSE(mentions(load(0, {5, 5.1, 5.2}).notes, "far outside of the others")) << "a second place";

    const Scene seeing = load(2, {100});
    EXPECT_EQ(seeing.train.size(), 12u);
    EXPECT_TRUE(mentions(seeing.notes, "1 of 12 cameras stand far outside of the others"));
    EXPECT_TRUE(mentions(seeing.notes, "(a.png)"));
    EXPECT_LE(seeing.extent, extent);
    EXPECT_GT(seeing.extent, 0.8 * extent);

    const Scene blind = load(0, {1000});
    EXPECT_EQ(blind.train.size(), 11u);
    EXPECT_TRUE(mentions(blind.notes, "1 of 12 images are left out of the training"));
    EXPECT_TRUE(mentions(blind.notes, "see none of the points (a.png)"));
    EXPECT_EQ(blind.extent, seeing.extent);
}

/// Writes twelve images of twenty points, of which the first `num_wrong` were moved sideways, to images.bin or
/// images.txt.
void write_seen_scene(const std::filesystem::path& folder, std::size_t num_wrong, bool text) {
    auto images = row_of_images(numbered(12));
    std::vector<TestPoint> points;
    for (std::uint64_t k = 0; k < 20; ++k)
        points.push_back({100 + k, 0.1 * double(k % 5) - 0.5, 0.1 * double(k / 5), 0.02 * double(k)});
    std::string lines;
    for (std::size_t i = 0; i < images.size(); ++i) {
        auto& pose = images[i].pose;
        for (const TestPoint& p : points)
            images[i].seen.push_back(
                {20 * (p.x + pose[4]) / (p.z + pose[6]) + 8, 20 * p.y / (p.z + pose[6]) + 6, p.id});
        images[i].seen.push_back({1, 1, 7});  // of no point
        if (i < num_wrong) pose[5] = 1;
        lines += fmt::format("{} {} {} {}\n", images[i].id, fmt::join(pose, " "), images[i].camera_id, images[i].name);
        for (const auto& seen : images[i].seen) lines += fmt::format("{} {} {} ", seen.x, seen.y, seen.point);
        lines += "3 3 -1\n";
    }
    const std::filesystem::path model = folder / "sparse/0";
    write_model(model, {TestCamera{}}, images, points);
    if (!text) return;
    for (const char* name : {"cameras.bin", "images.bin"}) std::filesystem::remove(model / name);
    spit(model / "cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
    spit(model / "images.txt", lines);
}

TEST(LoadScene, AnImageWhosePoseContradictsItsPointsIsLeftOut) {
    for (const bool text : {false, true}) {
        TempFolder folder;
        write_colmap_scene(folder.path(), numbered(12));
        const auto load = [&](std::size_t num_wrong, bool eval) {
            write_seen_scene(folder.path(), num_wrong, text);
            return load_unframed(at(folder.path(), eval));
        };
        EXPECT_TRUE(load(0, false).notes.empty());
        const Scene one = load(1, false);
        EXPECT_EQ(one.train.size(), 11u);
        EXPECT_TRUE(mentions(one.notes, "1 of 12 images are left out of the training"));
        EXPECT_TRUE(mentions(one.notes, "by up to 30 % of the image's size (a.png)")) << one.notes[0];
        const Scene scored = load(1, true);
        EXPECT_EQ(scored.train.size() + scored.test.size(), 12u);
        EXPECT_TRUE(mentions(scored.notes, "1 test images have poses that cannot be right"));
        EXPECT_EQ(load(4, false).train.size(), 12u) << "then the points are wrong, or the cameras";
    }
}

}  // namespace
}  // namespace gs
