// SPDX-License-Identifier: Apache-2.0
// transforms.json in its three dialects, and what wrong ones get.
#include "lib/scene/transforms_reader.h"

#include <Eigen/LU>
#include <cmath>

#include "kernels/base/error.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

using namespace test;

const std::string kMatrix = "\"transform_matrix\": [[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

TransformsFile parse(const TempFolder& folder, const std::string& text) {
    spit(folder / "transforms.json", text);
    return read_transforms(folder / "transforms.json");
}

std::string error_of(const TempFolder& folder, const std::string& text) {
    return message_of<DataError>([&] { parse(folder, text); });
}

std::string with_frame(const std::string& top, const std::string& frame = "") {
    return "{" + top + (top.empty() ? "" : ",") + "\"frames\": [{\"file_path\": \"./images\\\\a.png\", " +
           (frame.empty() ? "" : frame + ",") + kMatrix + "}]}";
}

LensCamera lens_of(const TempFolder& folder, const std::string& top, const std::string& frame = "", int width = 200,
                   int height = 100) {
    return resolve_intrinsics(parse(folder, with_frame(top, frame)).frames.at(0).intrinsics, width, height, "here");
}

TEST(TransformsReader, PoseIsConvertedFromOpenGlCameraToOpenCvWorldToCamera) {
    TempFolder folder;
    const TransformsFile file = parse(folder, with_frame("\"camera_angle_x\": 1"));
    ASSERT_EQ(file.frames.size(), 1u);
    const TransformsFrame& frame = file.frames[0];
    EXPECT_EQ(frame.file_path, "images/a.png");
    // The camera stands at (1,2,3) and looks along world -z, with world +y up.
    const auto seen = [&](double x, double y, double z) {
        return Eigen::Vector3d(frame.rotation * Eigen::Vector3d(x, y, z) + frame.translation);
    };
    EXPECT_LT((seen(1, 2, 3) - Eigen::Vector3d(0, 0, 0)).norm(), 1e-12);
    EXPECT_LT((seen(1, 2, 1) - Eigen::Vector3d(0, 0, 2)).norm(), 1e-12);
    EXPECT_LT((seen(1, 3, 3) - Eigen::Vector3d(0, -1, 0)).norm(), 1e-12);
    EXPECT_LT((seen(2, 2, 3) - Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
}

TEST(TransformsReader, BlenderFileHasSquarePixelsFromTheAngle) {
    TempFolder folder;
    const LensCamera lens = lens_of(folder, "\"camera_angle_x\": 0.6911112070083618", "", 800, 600);
    EXPECT_NEAR(lens.fx, 1111.1110311937682, 1e-9);
    EXPECT_EQ(lens.fy, lens.fx);
    EXPECT_EQ(lens.cx, 400);
    EXPECT_EQ(lens.cy, 300);
    EXPECT_TRUE(is_pinhole(lens));
}

TEST(TransformsReader, NerfstudioFileWithDistortionAndComments) {
    TempFolder folder;
    const LensCamera lens =
        lens_of(folder,
                "/* made by hand */ \"w\": 200.0, \"h\": 100, \"fl_x\": 150, \"fl_y\": 151, \"cx\": 99, \"cy\": 48, "
                "\"k1\": -0.1, \"k2\": 0.02, \"p1\": 0.001, \"p2\": 0.002, \"camera_model\": \"OPENCV\"",
                "", 400, 200);
    EXPECT_EQ(lens.model, CameraModel::kOpenCV);
    EXPECT_EQ(lens.width, 200) << "nominal size is the file's, not the image's";
    EXPECT_EQ(lens.fx, 150);
    EXPECT_EQ(lens.fy, 151);
    EXPECT_EQ(lens.cx, 99);
    EXPECT_EQ(lens.distortion[0], -0.1);
    EXPECT_EQ(lens.distortion[3], 0.002);
}

TEST(TransformsReader, InstantNgpFieldOfViewInDegrees) {
    TempFolder folder;
    const LensCamera lens = lens_of(folder, "\"x_fov\": 90, \"y_fov\": 53.13010235415598");
    EXPECT_NEAR(lens.fx, 100, 1e-9);
    EXPECT_NEAR(lens.fy, 100, 1e-9);
}

TEST(TransformsReader, FocalLengthPrecedence) {
    TempFolder folder;
    EXPECT_EQ(lens_of(folder, "\"fl_x\": 10, \"camera_angle_x\": 1").fx, 10);
    EXPECT_EQ(lens_of(folder, "\"fl_x\": 10", "\"fl_x\": 20").fx, 20);
    EXPECT_NEAR(lens_of(folder, "\"fl_x\": 10", "\"x_fov\": 90").fx, 100, 1e-9)
        << "frame angles come before file lengths";
    EXPECT_EQ(lens_of(folder, "\"fl_y\": 7").fx, 7);
    EXPECT_CONTAINS(message_of<DataError>([&] { lens_of(folder, "\"w\": 5"); }), "here: no focal length");
}

TEST(TransformsReader, LensKinds) {
    TempFolder folder;
    const std::string f = "\"fl_x\": 10, ";
    EXPECT_EQ(lens_of(folder, f + "\"k1\": 0.0").model, CameraModel::kPinhole);
    EXPECT_EQ(lens_of(folder, f + "\"k1\": -0.1").model, CameraModel::kOpenCV) << "without camera_model";
    EXPECT_EQ(lens_of(folder, f + "\"k3\": 0.1").model, CameraModel::kFullOpenCV);
    EXPECT_EQ(lens_of(folder, f + "\"k3\": 0.1").distortion[4], 0.1);
    EXPECT_EQ(lens_of(folder, f + "\"is_fisheye\": true, \"k4\": 0.5").model, CameraModel::kOpenCVFisheye);
    EXPECT_EQ(lens_of(folder, f + "\"camera_model\": \"OPENCV_FISHEYE\"", "\"k4\": 0.5").distortion[3], 0.5);
    EXPECT_CONTAINS(error_of(folder, with_frame(f + "\"camera_model\": \"FTHETA\"")),
                    "camera_model 'FTHETA' is unsupported");
    EXPECT_CONTAINS(error_of(folder, with_frame(f + "\"equirectangular\": true")), "'equirectangular' is unsupported");
    EXPECT_CONTAINS(error_of(folder, with_frame(f + "\"ftheta_p0\": 1.0")), "'ftheta' is unsupported");
    EXPECT_CONTAINS(error_of(folder, with_frame(f + "\"k4\": 0.5")), "k4 is 0.5");
}

TEST(TransformsReader, ExplicitSplitMasksAndPoints) {
    TempFolder folder;
    const TransformsFile file =
        parse(folder, with_frame("\"fl_x\": 1, \"test_filenames\": [\"./images/a.png\"], \"ply_file_path\": \"p.ply\"",
                                 "\"mask_path\": \"m/a.png\""));
    ASSERT_TRUE(file.test_filenames);
    EXPECT_EQ(file.test_filenames->at(0), "images/a.png");
    EXPECT_EQ(file.frames[0].mask_path, "m/a.png");
    EXPECT_EQ(file.point_file, "p.ply");
}

TEST(TransformsReader, ScaledMatricesAreReducedToRotations) {
    TempFolder folder;
    const TransformsFile file = parse(
        folder,
        "{\"fl_x\": 1, \"frames\": [{\"file_path\": \"a\", \"transform_matrix\": [[0,-2,0,1],[2,0,0,2],[0,0,2,3]]}]}");
    EXPECT_NEAR(file.frames[0].rotation.determinant(), 1, 1e-12);
    EXPECT_LT((-file.frames[0].rotation.transpose() * file.frames[0].translation - Eigen::Vector3d(1, 2, 3)).norm(),
              1e-12);
    EXPECT_TRUE(mentions(file.notes, "hold a scale"));
}

TEST(TransformsReader, ErrorsNameFileKeyAndValue) {
    TempFolder folder;
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": ["), "transforms.json: not valid JSON");
    EXPECT_CONTAINS(error_of(folder, "[1]"), "must be an object but is [1]");
    EXPECT_CONTAINS(error_of(folder, "{}"), "transforms.json: key 'frames' is missing");
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": 3}"), "key 'frames' must be a list but is 3");
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": [7]}"), "frame 0: must be an object but is 7");
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": [{" + kMatrix + "}]}"), "frame 0: key 'file_path' is missing");
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": [{\"file_path\": \"a\"}]}"), "key 'transform_matrix' is missing");
    EXPECT_CONTAINS(error_of(folder, "{\"frames\": [{\"file_path\": 5, " + kMatrix + "}]}"),
                    "key 'file_path' must be a string but is 5");
    EXPECT_CONTAINS(error_of(folder, with_frame("\"fl_x\": \"wide\"")), "key 'fl_x' must be a number but is \"wide\"");
    EXPECT_CONTAINS(error_of(folder, with_frame("\"fl_x\": -3")), "key 'fl_x' must be positive but is -3");
    EXPECT_CONTAINS(error_of(folder, with_frame("\"x_fov\": 180")), "between 0 and 180");
    EXPECT_CONTAINS(error_of(folder, with_frame("\"w\": 1e300")), "key 'w' must be an image size");
    EXPECT_CONTAINS(error_of(folder, with_frame("\"fl_x\": 1e999")), "not valid JSON");
}

TEST(TransformsReader, BadMatricesAreErrors) {
    TempFolder folder;
    for (const char* matrix : {"5", "[]", "[[1,0,0],[0,1,0],[0,0,1]]", "[[1,0,0,0],[0,1,0,0],[0,0,\"1\",0]]",
                               "[[0,0,0,0],[0,0,0,0],[0,0,0,0]]", "[[-1,0,0,0],[0,1,0,0],[0,0,1,0]]",
                               "[[1,1,0,0],[0,1,0,0],[0,0,1,0]]", "[[1,0,0,1e308],[0,1,0,1e308],[0,0,1e308,1]]"})
        EXPECT_CONTAINS(error_of(folder, std::string("{\"frames\": [{\"file_path\": \"a\", \"transform_matrix\": ") +
                                             matrix + "}]}"),
                        "frame 0: key 'transform_matrix' must be");
}

}  // namespace
}  // namespace gs
