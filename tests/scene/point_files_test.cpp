// SPDX-License-Identifier: Apache-2.0
// Which file the points of a scene come from, and what a PLY may hold.
#include "lib/scene/point_files.h"

#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;

constexpr const char* kXyz = "property float x\nproperty float y\nproperty float z\n";

/// A text PLY of the rows, with the lines of `properties`.
std::string text_ply(const std::string& properties, const std::vector<std::string>& rows) {
    std::string text =
        "ply\nformat ascii 1.0\nelement vertex " + std::to_string(rows.size()) + "\n" + properties + "end_header\n";
    for (const std::string& row : rows) text += row + "\n";
    return text;
}

/// A PLY of `count` points on the x axis, beginning at `x`.
std::string points_at(double x, int count) {
    std::vector<std::string> rows;
    for (int i = 0; i < count; ++i) rows.push_back(std::to_string(x + 0.01 * i) + " 0 0 255 0 0");
    return text_ply(std::string(kXyz) + "property uchar red\nproperty uchar green\nproperty uchar blue\n", rows);
}

struct ReadPly {
    SourcePoints points;
    std::vector<std::string> notes;
};

ReadPly read(const std::string& ply) {
    TempFolder folder;
    spit(folder / "p.ply", ply);
    ReadPly out;
    out.points = read_point_ply(folder / "p.ply", out.notes);
    return out;
}

TEST(PointPly, ColoursAreReadByNameTypeAndRange) {
    const auto color = [](const std::string& type, const std::string& prefix, const std::string& values) {
        std::string properties = kXyz;
        for (const char* name : {"red", "green", "blue"}) properties += "property " + type + " " + prefix + name + "\n";
        return read(text_ply(properties, {"0 0 0 " + values, "1 0 0 0 0 0"})).points.colors.at(0);
    };
    const Eigen::Vector3f expected(1, 0, 0.2f);
    EXPECT_TRUE(color("uchar", "", "255 0 51").isApprox(expected));
    EXPECT_TRUE(color("uint8", "diffuse_", "255 0 51").isApprox(expected));
    EXPECT_TRUE(color("char", "", "-1 0 51").isApprox(expected)) << "bytes that were written as signed ones";
    EXPECT_TRUE(color("int", "", "255 0 51").isApprox(expected));
    EXPECT_TRUE(color("ushort", "", "65535 0 13107").isApprox(expected));
    EXPECT_TRUE(color("ushort", "", "255 0 51").isApprox(expected));
    EXPECT_TRUE(color("float", "", "1 0 0.2").isApprox(expected));
    EXPECT_TRUE(color("double", "", "255 0 51").isApprox(expected));
}

TEST(PointPly, OtherPropertiesDoNotMatter) {
    const ReadPly file =
        read(text_ply("property double x\nproperty double y\nproperty double z\nproperty float nx\nproperty float ny\n"
                      "property float nz\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
                      "property uchar alpha\nproperty list uchar int faces\n",
                      {"1e3 2 3 0 0 1 255 0 51 128 2 7 8"}));
    EXPECT_EQ(file.points.positions.at(0), Eigen::Vector3d(1000, 2, 3));
    EXPECT_FLOAT_EQ(file.points.colors.at(0)[2], 0.2f);
    EXPECT_TRUE(file.notes.empty());
}

TEST(PointPly, RowsThatAreNotFiniteAndMissingColoursAreNoted) {
    const ReadPly file = read(text_ply(kXyz, {"0 0 0", "nan 0 0", "0 -inf 0", "1 0 1e300"}));
    EXPECT_EQ(file.points.positions.size(), 1u);
    EXPECT_EQ(file.points.colors.at(0), Eigen::Vector3f(0.5f, 0.5f, 0.5f));
    EXPECT_TRUE(mentions(file.notes, "p.ply: 3 of 4 points are not finite: skipped"));
    EXPECT_TRUE(mentions(file.notes, "p.ply: its points have no colours: grey"));
}

TEST(PointPly, AModelOfGaussiansGivesItsMeansAndBaseColours) {
    const ReadPly file =
        read(text_ply(std::string(kXyz) + "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
                                          "property float opacity\nproperty float scale_0\nproperty float rot_0\n",
                      {"1 2 3 1 0 -9 0 0 0"}));
    EXPECT_EQ(file.points.positions.at(0), Eigen::Vector3d(1, 2, 3));
    EXPECT_TRUE(file.points.colors.at(0).isApprox(Eigen::Vector3f(0.7820948f, 0.5f, 0)));
    EXPECT_TRUE(mentions(file.notes, "it is a model of Gaussians"));
}

TEST(PointPly, ACompressedModelIsNamed) {
    TempFolder folder;
    spit(folder / "p.ply",
         "ply\nformat ascii 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\n"
         "property uint packed_position\nend_header\n1\n2\n");
    std::vector<std::string> notes;
    EXPECT_CONTAINS(message_of<DataError>([&] { read_point_ply(folder / "p.ply", notes); }), "compressed model");
}

std::size_t num_points(const std::filesystem::path& scene) { return load_unframed(at(scene)).points.positions.size(); }

TEST(PointFiles, AColmapSceneTakesThePlyOfItsModelFirstAndSaysWhatIsNotUsed) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));  // with three points
    spit(folder / "sparse/0/points3d.ply", points_at(0, 5));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.points.positions.size(), 5u);
    EXPECT_TRUE(mentions(scene.facts, "points: 5 of " + (folder / "sparse/0/points3d.ply").string()));
    EXPECT_TRUE(mentions(scene.notes, "not used: " + (folder / "sparse/0/points3D.bin").string() + " (3 points)"));
}

TEST(PointFiles, AnEmptyPlyGivesWayToColmapsPoints) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));
    spit(folder / "sparse/0/points3D.ply", points_at(0, 0));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.points.positions.size(), 3u);
    EXPECT_TRUE(mentions(scene.notes, "points3D.ply: it holds no points"));
}

TEST(PointFiles, ACopyOfColmapsPointsIsNotPreferred) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));
    spit(folder / "sparse/0/points3D.ply", points_at(9, 3));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.points.positions[0], Eigen::Vector3f(0, 0, 0));
    EXPECT_TRUE(scene.notes.empty());
    EXPECT_TRUE(mentions(scene.facts, "is taken for a copy"));
}

TEST(PointFiles, AColmapSceneTakesPointsOfTheFoldersAboveItsModel) {
    TempFolder folder;
    write_colmap_scene(folder.path(), numbered(2));
    std::filesystem::rename(folder / "sparse/0/points3D.bin", folder / "points3D.bin");
    EXPECT_EQ(num_points(folder.path()), 3u);
    EXPECT_EQ(num_points(folder.path().string() + "/"), 3u);
    spit(folder / "sparse/0/points3D.txt", "1 0 0 0 255 0 0 0.5\n2 0.1 0 0 255 0 0 0.5\n");
    EXPECT_EQ(num_points(folder.path()), 2u) << "points as text beside a binary model";
    std::filesystem::remove(folder / "sparse/0/points3D.txt");
    std::filesystem::remove(folder / "points3D.bin");
    spit(folder / "points3D.PLY", points_at(0, 4));
    EXPECT_EQ(num_points(folder.path()), 4u);
}

TEST(PointFiles, NerfSyntheticScenesUseThePlyBesideThem) {
    TempFolder folder;
    const auto write = [&](const std::string& more) {
        spit(folder / "transforms_train.json",
             "{\"camera_angle_x\": 0.8, " + more + "\"frames\": [" + frame("train/r_0") + "]}");
    };
    write_png(folder / "train/r_0.png");
    write("");
    EXPECT_EQ(num_points(folder.path()), 0u);
    spit(folder / "points3D.ply", points_at(0, 4));
    EXPECT_EQ(num_points(folder.path()), 4u);
    spit(folder / "other.ply", points_at(0, 6));
    write("\"ply_file_path\": \"./other.ply\", ");
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.points.positions.size(), 6u);
    EXPECT_TRUE(mentions(scene.notes, "points3D.ply (4 points); ply_file_path names the first"));
    write("\"ply_file_path\": \"gone.ply\", ");
    const Scene without = load_unframed(at(folder.path()));
    EXPECT_EQ(without.points.positions.size(), 4u);
    EXPECT_TRUE(mentions(without.notes, "ply_file_path 'gone.ply' does not exist: ignored"));
}

TEST(PointFiles, ATransformsFileUsesThePlyBesideIt) {
    TempFolder folder;
    write_transforms_scene(folder.path(), {"images/a.png"});
    spit(folder / "pointcloud.ply", points_at(0, 4));
    EXPECT_EQ(num_points(folder.path()), 4u);
    spit(folder / "sparse_pc.ply", points_at(0, 5));
    const Scene scene = load_unframed(at(folder.path()));
    EXPECT_EQ(scene.points.positions.size(), 5u);
    EXPECT_TRUE(mentions(scene.notes, "pointcloud.ply (4 points)"));
    write_transforms_scene(folder.path(), {"images/a.png"}, "\"ply_file_path\": \"/elsewhere/pointcloud.ply\", ");
    EXPECT_EQ(num_points(folder.path()), 4u) << "a path of another machine";
}

}  // namespace
}  // namespace gs
