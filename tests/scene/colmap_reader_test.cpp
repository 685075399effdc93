// SPDX-License-Identifier: Apache-2.0
// COLMAP models: binary against text, tolerances of the text form, every kind of damage.
#include "lib/scene/colmap_reader.h"

#include <chrono>
#include <cmath>
#include <limits>

#include "kernels/base/error.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

std::string error_of(const std::filesystem::path& folder) {
    return message_of<DataError>([&] { read_colmap_model(folder); });
}

TEST(ColmapReader, BinaryAndTextAreEqual) {
    TempFolder folder;
    write_model(folder / "bin",
                {{3, 4, 640, 480, {500, 510, 320, 240, 0.1, -0.2, 0.001, 0.002}}, {9, 0, 16, 12, {20, 8, 6}}},
                {{1, {0.5, 0.5, -0.5, 0.5, 1, 2, 3}, 3, "sub dir/a b.jpg", 2},
                 {5, {2, 0, 0, 0, -1, 0.25, 1e-3}, 9, "z.png", 0}},
                {{4, 0.1, -2, 3e5, 1, 2, 3, 2}, {6, 1, 1, 1, 255, 0, 9, 0}});
    spit(folder / "txt/cameras.txt",
         "# comment\n\n3 OPENCV 640 480 500 510 320 240 0.1 -0.2 0.001 0.002\r\n9\tSIMPLE_PINHOLE 16  12 20 8 6\n");
    // The image without 2D points has an empty second line; names may hold blanks.
    spit(folder / "txt/images.txt",
         "# Image list\n1 0.5 0.5 -0.5 0.5 1 2 3 3 sub dir/a b.jpg\n1.5 2.5 -1 3 4 7\r\n5 2 0 0 0 -1 0.25 1e-3 9 "
         "z.png\r\n\n");
    spit(folder / "txt/points3D.txt", "4 0.1 -2 3e5 1 2 3 0.5 1 0 5 7\n6 1 1 1 255 0 9 0.1\n");
    const ColmapModel a = read_colmap_model(folder / "bin"), b = read_colmap_model(folder / "txt");
    ASSERT_EQ(a.cameras.size(), 2u);
    EXPECT_EQ(a.cameras, b.cameras);
    ASSERT_EQ(a.images.size(), 2u);
    ASSERT_EQ(b.images.size(), 2u);
    for (int i = 0; i < 2; ++i) {
        EXPECT_EQ(a.images[i].id, b.images[i].id);
        EXPECT_EQ(a.images[i].camera_id, b.images[i].camera_id);
        EXPECT_EQ(a.images[i].name, b.images[i].name);
        EXPECT_EQ(a.images[i].rotation, b.images[i].rotation);
        EXPECT_EQ(a.images[i].translation, b.images[i].translation);
    }
    EXPECT_EQ(a.images[0].name, "sub dir/a b.jpg");
    EXPECT_EQ(a.points.positions, b.points.positions);
    EXPECT_EQ(a.points.colors, b.points.colors);
    EXPECT_FLOAT_EQ(a.points.colors[1][2], 9 / 255.0f);
    EXPECT_TRUE(a.notes.empty());
    EXPECT_TRUE(b.notes.empty());
}

TEST(ColmapReader, QuaternionsAreNormalised) {
    TempFolder folder;
    const double s = std::sqrt(0.5) * 3;  // 90 degrees about z, three times too long
    write_model(folder.path(), {TestCamera{}}, {{1, {s, 0, 0, s, 0, 0, 0}, 1, "a"}}, {});
    const ColmapModel model = read_colmap_model(folder.path());
    Eigen::Matrix3d expected;
    expected << 0, -1, 0, 1, 0, 0, 0, 0, 1;
    EXPECT_LT((model.images[0].rotation - expected).norm(), 1e-14);
}

TEST(ColmapReader, AllModelsHaveTheirParameterCountInBothForms) {
    TempFolder folder;
    for (const CameraModelInfo& info : camera_models()) {
        std::vector<double> params(info.num_params(), 0.0);
        params[0] = params[1] = 100;
        TestCamera camera{1, static_cast<int>(info.id), 100, 100, params};
        write_model(folder / "bin", {camera}, {TestImage{}}, {});
        std::string line = "1 " + std::string(info.name) + " 100 100";
        for (const double p : params) line += " " + std::to_string(p);
        spit(folder / "txt/cameras.txt", line + "\n");
        spit(folder / "txt/images.txt", "1 1 0 0 0 0 0 4 1 a.png\n\n");
        EXPECT_EQ(read_colmap_model(folder / "bin").cameras, read_colmap_model(folder / "txt").cameras) << info.name;
    }
}

TEST(ColmapReader, TruncationAtEveryByteIsAnErrorNamingTheFile) {
    TempFolder folder;
    const std::vector<TestCamera> cameras = {TestCamera{}};
    const std::vector<TestImage> images = {{1, {1, 0, 0, 0, 0, 0, 4}, 1, "a.png", 2},
                                           {2, {1, 0, 0, 0, 0, 0, 4}, 1, "b.png", 1}};
    const std::vector<TestPoint> points = {{1, 0, 0, 0, 1, 2, 3, 2}, {2, 0, 0, 0, 1, 2, 3, 0}};
    const std::pair<const char*, std::string> files[] = {{"cameras.bin", cameras_bin(cameras)},
                                                         {"images.bin", images_bin(images)},
                                                         {"points3D.bin", points_bin(points)}};
    for (const auto& [name, bytes] : files)
        for (std::size_t size = 0; size < bytes.size(); ++size) {
            write_model(folder.path(), cameras, images, points);
            spit(folder / name, bytes.substr(0, size));
            SCOPED_TRACE(size);
            EXPECT_CONTAINS(error_of(folder.path()), name);
        }
}

TEST(ColmapReader, HugeCountsAreRefusedBeforeAllocating) {
    TempFolder folder;
    for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
        write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {TestPoint{}});
        std::string bytes = slurp(folder / name);
        const std::uint64_t count = std::uint64_t(1) << 60;
        bytes.replace(0, 8, reinterpret_cast<const char*>(&count), 8);
        spit(folder / name, bytes);
        EXPECT_CONTAINS(error_of(folder.path()), "1152921504606846976");
        EXPECT_CONTAINS(error_of(folder.path()), name);
    }
    // Inner counts whose product with the record size overflows 64 bits.
    for (const std::uint64_t count : {std::uint64_t(1) << 60, std::uint64_t(1) << 61, ~std::uint64_t(0)}) {
        write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {TestPoint{}});
        std::string bytes = slurp(folder / "points3D.bin");
        bytes.replace(bytes.size() - 8, 8, reinterpret_cast<const char*>(&count), 8);
        spit(folder / "points3D.bin", bytes);
        EXPECT_CONTAINS(error_of(folder.path()), "track length");
    }
}

TEST(ColmapReader, UnknownModelNamesFileFieldAndValue) {
    TempFolder folder;
    for (const int id : {-1, 18, 12345}) {
        write_model(folder.path(), {{7, id, 16, 12, {1, 1, 1}}}, {}, {});
        const std::string message = error_of(folder.path());
        EXPECT_CONTAINS(message, "cameras.bin: camera 7: model_id is " + std::to_string(id));
    }
    TempFolder text;
    spit(text / "cameras.txt", "1 FISHY 16 12 20 8 6\n");
    spit(text / "images.txt", "");
    EXPECT_CONTAINS(error_of(text.path()), "cameras.txt: line 1: MODEL is 'FISHY'");
}

TEST(ColmapReader, BadCamerasAreErrors) {
    TempFolder folder;
    const auto error_with = [&](TestCamera camera) {
        write_model(folder.path(), {camera}, {TestImage{}}, {});
        return error_of(folder.path());
    };
    EXPECT_CONTAINS(error_with({1, 1, 0, 12, {20, 20, 8, 6}}), "0 x 12");
    EXPECT_CONTAINS(error_with({1, 1, 16, std::uint64_t(1) << 40, {20, 20, 8, 6}}), "1099511627776");
    EXPECT_CONTAINS(error_with({1, 1, 16, 12, {20, kNan, 8, 6}}), "parameter 1");
    EXPECT_CONTAINS(error_with({1, 1, 16, 12, {0, 20, 8, 6}}), "focal length");
    EXPECT_CONTAINS(error_with({1, 1, 16, 12, {-20, 20, 8, 6}}), "focal length");
}

TEST(ColmapReader, DuplicateIdsAndMissingCamerasAreErrors) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}, TestCamera{}}, {}, {});
    EXPECT_CONTAINS(error_of(folder.path()), "camera 1: the id appears twice");
    write_model(folder.path(), {TestCamera{}}, {TestImage{}, TestImage{}}, {});
    EXPECT_CONTAINS(error_of(folder.path()), "image 1 ('a.png'): the id appears twice");
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {TestPoint{}, TestPoint{}});
    EXPECT_CONTAINS(error_of(folder.path()), "point 1: the id appears twice");
    write_model(folder.path(), {TestCamera{}}, {{1, {1, 0, 0, 0, 0, 0, 0}, 42, "a.png"}}, {});
    EXPECT_CONTAINS(error_of(folder.path()), "camera_id 42");
}

TEST(ColmapReader, NonFinitePosesAndPointsAreSkippedAndNoted) {
    TempFolder folder;
    write_model(
        folder.path(), {TestCamera{}},
        {{1, {1, 0, 0, 0, kNan, 0, 0}, 1, "a"}, {2, {0, 0, 0, 0, 0, 0, 0}, 1, "b"}, {3, {1, 0, 0, 0, 0, 0, 0}, 1, "c"}},
        {{1, kNan, 0, 0}, {2, 1, 1, 1}, {3, 0, 1e300, 0}});
    const ColmapModel model = read_colmap_model(folder.path());
    ASSERT_EQ(model.images.size(), 1u);
    EXPECT_EQ(model.images[0].name, "c");
    EXPECT_EQ(model.points.positions.size(), 1u);
    EXPECT_TRUE(mentions(model.notes, "2 images with a non-finite or zero pose (first: a)"));
    EXPECT_TRUE(mentions(model.notes, "2 points with non-finite"));
}

TEST(ColmapReader, TrailingBytesAreNotedAndRigFilesIgnored) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {TestPoint{}});
    spit(folder / "points3D.bin", slurp(folder / "points3D.bin") + "xyz");
    spit(folder / "rigs.bin", "garbage");
    spit(folder / "frames.bin", "garbage");
    const ColmapModel model = read_colmap_model(folder.path());
    EXPECT_EQ(model.points.positions.size(), 1u);
    EXPECT_TRUE(mentions(model.notes, "points3D.bin: 3 bytes after the last record"));
}

TEST(ColmapReader, PointsMayBeAbsentOrEmpty) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {});
    EXPECT_TRUE(read_colmap_model(folder.path()).points.positions.empty());
    std::filesystem::remove(folder / "points3D.bin");
    EXPECT_TRUE(read_colmap_model(folder.path()).points.positions.empty());
}

TEST(ColmapReader, TextErrorsNameLineFieldAndValue) {
    TempFolder folder;
    spit(folder / "cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
    const auto error_with = [&](const std::string& images, const std::string& points) {
        spit(folder / "images.txt", images);
        spit(folder / "points3D.txt", points);
        return error_of(folder.path());
    };
    EXPECT_CONTAINS(error_with("# c\n1 1 0 0 zero 0 0 4 1 a.png\n\n", ""), "images.txt: line 2: field pose is 'zero'");
    EXPECT_CONTAINS(error_with("1 1 0 0 0 0 0 4\n\n", ""), "field CAMERA_ID is missing");
    EXPECT_CONTAINS(error_with("1 1 0 0 0 0 0 4 1\n\n", ""), "the name is empty");
    EXPECT_CONTAINS(error_with("", "1 0 0 0 256 0 0 0\n"), "colour 256");
    EXPECT_CONTAINS(error_with("", "1 0 0 1e999 0 0 0 0\n"), "'1e999'");
    EXPECT_CONTAINS(error_with("1 1 0 0 0 0,5 0 4 1 a.png\n\n", ""),
                    "'0,5'; must be a number in range, with a decimal point");
    EXPECT_CONTAINS(error_with("-1 1 0 0 0 0 0 4 1 a\n\n", ""), "IMAGE_ID is '-1'");
}

/// Returns the names of the images that are read from an images.txt.
std::vector<std::string> names_in(const std::string& images) {
    TempFolder folder;
    spit(folder / "cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
    spit(folder / "images.txt", images);
    std::vector<std::string> names;
    for (const ColmapImage& image : read_colmap_model(folder.path()).images) names.push_back(image.name);
    return names;
}

TEST(ColmapReader, TheSecondLineOfAnImageIsOptional) {
    const std::string a = "1 1 0 0 0 0 0 4 1 a.png\n", b = "2 1 0 0 0 0 0 4 1 b c.png\n", c = "3 1 0 0 0 0 0 4 1 007\n";
    const std::vector<std::string> all = {"a.png", "b c.png", "007"};
    EXPECT_EQ(names_in(a + b + c), all);
    EXPECT_EQ(names_in(a + b + c + "\n"), all);
    EXPECT_EQ(names_in(a + "\n" + b + "\n" + c + "\n"), all);
    EXPECT_EQ(names_in(a + "\n\n\n" + b + "\n\n" + c), all);
    EXPECT_EQ(names_in(a + "1.5 2.5 -1 3 4 7\n" + b + c + "1 2 3 4 5 6 7 8 9 10 11 12\n"), all);
    EXPECT_EQ(names_in(a + "1.5 2.5 -1 3 4 7 5 6\n" + b + "# a comment\n" + c), all) << "points that are cut short";
}

TEST(ColmapReader, TextsMayBeginWithAByteOrderMarkAndHaveOddPoints) {
    TempFolder folder;
    const std::string mark = "\xef\xbb\xbf";
    spit(folder / "cameras.txt", mark + "1 PINHOLE 16 12 20 20 8 6\r\n");
    spit(folder / "images.txt", mark + "1 1 0 0 0 0 0 4 1 a.png\r\n\r\n2 1 0 0 0 0 0 4 1 b.png\r\n");
    spit(folder / "points3D.txt", mark + "1 0 0 1 128.0 255.0 9 -1\r\n2 0 0 1 1 2 3\r\n");
    const ColmapModel model = read_colmap_model(folder.path());
    EXPECT_EQ(model.images.size(), 2u);
    ASSERT_EQ(model.points.colors.size(), 2u);
    EXPECT_FLOAT_EQ(model.points.colors[0][0], 128 / 255.0f);
    EXPECT_TRUE(model.notes.empty());
    spit(folder / "points3D.txt", "1 0 0 1 0.5 1 0.25 0\n2 0 0 1 0 0 0 0\n");
    const ColmapModel unit = read_colmap_model(folder.path());
    EXPECT_FLOAT_EQ(unit.points.colors[0][0], 0.5f);
    EXPECT_TRUE(mentions(unit.notes, "no colour is above 1"));
    spit(folder / "images.txt", "\xff\xfe" + std::string("1\0 \0", 4));
    EXPECT_CONTAINS(error_of(folder.path()), "images.txt: is a text in UTF-16");
}

TEST(ColmapReader, OneUnusableCameraLeavesOutItsImagesAlone) {
    TempFolder folder;
    const std::vector<TestImage> images = {{1, {1, 0, 0, 0, 0, 0, 4}, 1, "a.png"},
                                           {2, {1, 0, 0, 0, 0, 0, 4}, 2, "b.png"}};
    for (const auto& [width, focal] :
         {std::pair(16, 0.0), std::pair(16, kNan), std::pair(16, -5.0), std::pair(0, 20.0)}) {
        write_model(folder.path(), {TestCamera{}, {2, 1, std::uint64_t(width), 12, {focal, 20, 8, 6}}}, images, {});
        const ColmapModel model = read_colmap_model(folder.path());
        ASSERT_EQ(model.images.size(), 1u);
        EXPECT_EQ(model.images[0].name, "a.png");
        EXPECT_TRUE(
            mentions(model.notes, "1 images are left out because their camera cannot be used (first: 'b.png': "));
    }
    write_model(folder.path(), {TestCamera{}}, images, {});
    EXPECT_TRUE(mentions(read_colmap_model(folder.path()).notes, "camera_id 2 is not among those of cameras.bin"));
    // A model number that is not known is passed over if nothing follows that would have to be found.
    write_model(folder.path(), {TestCamera{}, {2, 99, 16, 12, {1, 2, 3}}}, images, {});
    EXPECT_TRUE(mentions(read_colmap_model(folder.path()).notes, "camera 2: model_id is 99"));
    spit(folder / "txt/cameras.txt", "2 FISHY 16 12 20 8 6\n1 PINHOLE 16 12 20 20 8 6\n");
    spit(folder / "txt/images.txt", "1 1 0 0 0 0 0 4 1 a.png\n2 1 0 0 0 0 0 4 2 b.png\n");
    EXPECT_TRUE(mentions(read_colmap_model(folder / "txt").notes,
                         "'b.png': " + (folder / "txt/cameras.txt").string() + ": line 1: MODEL is 'FISHY'"));
}

TEST(ColmapReader, UnusableCamerasWithoutImagesDoNotMatter) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}, {2, 1, 16, 12, {kNan, 20, 8, 6}}}, {TestImage{}}, {});
    const ColmapModel model = read_colmap_model(folder.path());
    EXPECT_EQ(model.images.size(), 1u);
    EXPECT_TRUE(model.notes.empty());
}

TEST(ColmapReader, ABinaryModelBesideATextThatDiffersIsSaid) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {});
    spit(folder / "cameras.txt", "1 PINHOLE 16 12 20 20 8 6\n");
    spit(folder / "images.txt", "1 1 0 0 0 0 0 4 1 a.png\n2 1 0 0 0 0 0 4 1 b.png\n");
    const auto before = std::filesystem::last_write_time(folder / "images.bin") - std::chrono::hours(1);
    const auto age_text = [&] {
        for (const char* name : {"cameras.txt", "images.txt"}) std::filesystem::last_write_time(folder / name, before);
    };
    age_text();
    EXPECT_TRUE(mentions(read_colmap_model(folder.path()).notes,
                         "the .bin files are read (1 images), not the .txt files beside them (2 images)"));
    spit(folder / "images.txt", "1 1 0 0 0 0 0 4 1 a.png\n\n");
    age_text();
    EXPECT_TRUE(read_colmap_model(folder.path()).notes.empty()) << "two forms of one model";
    std::filesystem::last_write_time(folder / "images.txt", before + std::chrono::hours(2));
    EXPECT_TRUE(mentions(read_colmap_model(folder.path()).notes, "not the newer .txt files"));
}

TEST(ColmapReader, PointsMayLieThereInTheOtherFormAlone) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {});
    std::filesystem::remove(folder / "points3D.bin");
    spit(folder / "points3D.txt", "1 0 0 1 9 9 9 0\n");
    EXPECT_EQ(read_colmap_model(folder.path()).points.positions.size(), 1u);
}

TEST(FindColmapModel, PrefersTheModelWithMostImagesAndSaysSo) {
    TempFolder folder;
    std::vector<std::string> notes;
    EXPECT_TRUE(find_colmap_model(folder.path(), notes).empty());
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {});
    EXPECT_EQ(find_colmap_model(folder.path(), notes), folder.path());
    write_model(folder / "sparse", {TestCamera{}}, {TestImage{}}, {});
    EXPECT_EQ(find_colmap_model(folder.path(), notes), folder / "sparse");
    write_model(folder / "sparse/0", {TestCamera{}}, row_of_images({"a", "b"}), {});
    EXPECT_EQ(find_colmap_model(folder.path(), notes), folder / "sparse/0");
    EXPECT_TRUE(notes.empty());
    write_model(folder / "sparse/1", {TestCamera{}}, row_of_images({"a", "b", "c"}), {});
    EXPECT_EQ(find_colmap_model(folder.path(), notes), folder / "sparse/1");
    EXPECT_TRUE(mentions(notes, "using 1, which has the most images (3)"));
}

TEST(FindColmapModel, EntriesThatCannotBeSearchedArePassedOverBesideAModel) {
    TempFolder folder;
    std::vector<std::string> notes;
    std::filesystem::create_directories(folder / "sparse");
    std::filesystem::create_symlink("loop", folder / "sparse/loop");
    EXPECT_CONTAINS(message_of<DataError>([&] { find_colmap_model(folder.path(), notes); }), "sparse/loop: ");
    write_model(folder / "sparse/0", {TestCamera{}}, {TestImage{}}, {});
    EXPECT_EQ(find_colmap_model(folder.path(), notes), folder / "sparse/0");
    EXPECT_TRUE(mentions(notes, "passed over"));
}

TEST(FindColmapModel, BinaryIsPreferredToText) {
    TempFolder folder;
    write_model(folder.path(), {TestCamera{}}, {TestImage{}}, {});
    spit(folder / "cameras.txt", "not even a camera");
    spit(folder / "images.txt", "nor an image");
    EXPECT_EQ(read_colmap_model(folder.path()).images.size(), 1u);
}

}  // namespace
}  // namespace gs
