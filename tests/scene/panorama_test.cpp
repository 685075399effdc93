// SPDX-License-Identifier: Apache-2.0
// Faces of photographs of 360 degrees, and the photographs' cameras from those of their faces.
#include "lib/scene/panorama.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>

#include "kernels/base/error.h"
#include "lib/io/image.h"
#include "tests/core/temporary_folder.h"
#include "tests/scene/scene_fixture.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;

/// Returns the camera axes of a face in the frame of the photograph: it looks 60 degrees further to the right each.
Eigen::Matrix3d face_axes(int face) {
    const double angle = std::numbers::pi / 3 * face;
    Eigen::Matrix3d axes;  // columns: right, down, forward
    axes << std::cos(angle), 0, std::sin(angle), 0, 1, 0, -std::sin(angle), 0, std::cos(angle);
    return axes;
}

Vector3d color_of(const Vector3d& direction) { return 0.5 * (direction.normalized().array() + 1); }

/// Returns a panorama whose colours are the directions.
Image directions(int width, int channels = 3) {
    Image image{width, width / 2, channels, {}, {}};
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < width; ++x) {
            const double longitude = (2 * (x + 0.5) / width - 1) * std::numbers::pi,
                         latitude = ((y + 0.5) / image.height - 0.5) * std::numbers::pi;
            const Vector3d color = color_of({std::cos(latitude) * std::sin(longitude), std::sin(latitude),
                                             std::cos(latitude) * std::cos(longitude)});
            for (int c = 0; c < channels; ++c) image.u8.push_back(c < 3 ? to_8_bits(float(color[c])) : 255);
        }
    return image;
}

TEST(Panorama, AFaceShowsTheDirectionsAroundItsOwn) {
    const test::TemporaryFolder folder;
    write_image(folder.path() / "photographs/sub/a.png", directions(512, 4));
    std::size_t done = 0;
    const std::string parameters = write_faces(folder.path() / "photographs", {"sub/a.png"}, folder.path() / "faces",
                                               [&](std::size_t count, std::size_t all) {
                                                   EXPECT_EQ(all, 1u);
                                                   done = count;
                                               });
    EXPECT_EQ(parameters, "81.5,81.5,81.5") << "512 / pi = 163 pixels";
    EXPECT_EQ(done, 1u);
    for (int face = 0; face < kPanoramaFaces; ++face) {
        const std::string name = "sub/a.png/face" + std::to_string(face) + ".jpg";
        EXPECT_EQ(face_name("sub/a.png", face), name);
        const Image image = read_image(folder.path() / "faces" / name);
        ASSERT_EQ(image.width, 163);
        ASSERT_EQ(image.height, 163);
        EXPECT_EQ(image.channels, 3) << "alpha is dropped";
        double worst = 0;
        for (int y = 0; y < 163; ++y)
            for (int x = 0; x < 163; ++x) {
                const Vector3d wanted =
                    color_of(face_axes(face) * Vector3d((x + 0.5) / 81.5 - 1, (y + 0.5) / 81.5 - 1, 1));
                for (int c = 0; c < 3; ++c) worst = std::max(worst, std::abs(wanted[c] - image.value(x, y, c)));
            }
        EXPECT_LT(worst, 0.03) << "face " << face << "; JPEG takes a part of that";
    }
}

TEST(Panorama, PhotographsOfOtherShapesAreRefusedByNameAndUnreadableOnesAreLeftOut) {
    const test::TemporaryFolder folder;
    write_image(folder.path() / "a.png", directions(64));
    write_image(folder.path() / "b.png", test::gradient_image(60, 40));
    folder.write("c.png", "no picture");
    const auto write = [&](const std::vector<std::string>& names) {
        return write_faces(folder.path(), names, folder.path() / "faces", [](std::size_t, std::size_t) {});
    };
    try {
        write({"a.png", "b.png"});
        FAIL();
    } catch (const DataError& e) {
        EXPECT_CONTAINS(e.what(), "b.png: is 60x40; a photograph of 360 degrees (EQUIRECTANGULAR) is twice as wide");
    }
    EXPECT_EQ(write({"a.png", "c.png"}), "10,10,10");
    EXPECT_TRUE(fs::exists(folder.path() / "faces/a.png/face5.jpg"));
    EXPECT_FALSE(fs::exists(folder.path() / "faces/c.png"));
    write_image(folder.path() / "d.png", directions(32));
    EXPECT_EQ(write({"a.png", "d.png"}), "10,10,10") << "of the wider one";
    EXPECT_EQ(read_image_info(folder.path() / "faces/d.png/face0.jpg").width, 20) << "all faces share a pinhole";
}

class FacesOfPanoramas : public ::testing::Test {
  protected:
    FacesOfPanoramas() { model_.folder = "model"; }

    /// Adds a face of a photograph at a place, turned from its rotation by an angle.
    void add(const std::string& photograph, int face, const Eigen::Matrix3d& rotation, const Vector3d& center,
             double degrees = 0) {
        ColmapImage image;
        image.name = face_name(photograph, face);
        const Eigen::AngleAxisd turn(degrees * std::numbers::pi / 180, Vector3d(1, 2, 2) / 3);
        image.rotation = face_axes(face).transpose() * turn.toRotationMatrix() * rotation;
        image.translation = -image.rotation * center;
        model_.images.push_back(image);
    }
    ColmapModel written() {
        result_ = write_panorama_model(model_, folder_.path(), folder_.path() / "sparse/0");
        return read_colmap_model(folder_.path() / "sparse/0");
    }

    test::TemporaryFolder folder_;
    ColmapModel model_;
    PanoramaModel result_;
    const Eigen::Matrix3d rotation_ = Eigen::Quaterniond(0.5, -0.4, 0.7, 0.2).normalized().toRotationMatrix();
};

TEST_F(FacesOfPanoramas, AFaceStatesThePoseOfItsPhotograph) {
    for (int face = 0; face < kPanoramaFaces; ++face) {
        const std::string name = "sub/" + std::to_string(face) + ".png";
        write_image(folder_.path() / name, directions(face < 3 ? 64 : 32));
        add(name, face, rotation_, {face + 0.5, 2, -3});
    }
    model_.points.positions = {{1, 2.5, 1e-9}, {-4, 1e5, 6}};
    model_.points.colors = {{1, 0.2f, 0}, {0, 0, 1}};
    const ColmapModel read = written();
    ASSERT_EQ(read.images.size(), 6u);
    for (int face = 0; face < kPanoramaFaces; ++face) {
        const ColmapImage& image = read.images[std::size_t(face)];
        EXPECT_EQ(image.name, "sub/" + std::to_string(face) + ".png");
        EXPECT_LT((image.rotation - rotation_).cwiseAbs().maxCoeff(), 1e-12);
        EXPECT_LT((-image.rotation.transpose() * image.translation - Vector3d(face + 0.5, 2, -3)).norm(), 1e-12);
        const LensCamera& camera = read.cameras.at(image.camera_id);
        EXPECT_EQ(camera.model, CameraModel::kEquirectangular);
        EXPECT_EQ(camera.width, face < 3 ? 64 : 32);
        EXPECT_EQ(camera.fy, camera.height);
    }
    EXPECT_EQ(read.cameras.size(), 2u);
    EXPECT_EQ(read.points.positions, model_.points.positions);
    EXPECT_EQ(read.points.colors, model_.points.colors);
    EXPECT_TRUE(read.notes.empty());
    EXPECT_FALSE(result_.disagreement) << "every photograph has one face";
    EXPECT_TRUE(result_.contradictory.empty());
}

TEST_F(FacesOfPanoramas, APoseIsCombinedFromTheFacesThatAgree) {
    write_image(folder_.path() / "a.png", directions(64));
    add("a.png", 0, rotation_, {1, 2, 3}, 0.4);
    add("a.png", 4, rotation_, {9, 9, 9}, 50);  // errors of colmap's
    add("a.png", 2, rotation_, {-50, 40, 2});
    add("a.png", 1, rotation_, {1.1, 1.9, 3}, -0.3);
    add("a.png", 5, rotation_, {0.9, 2.1, 3.2}, -0.1);
    const ColmapModel read = written();
    ASSERT_EQ(read.images.size(), 1u);
    EXPECT_LT((read.images[0].rotation - rotation_).cwiseAbs().maxCoeff(), 1e-5);
    const Vector3d center = -read.images[0].rotation.transpose() * read.images[0].translation;
    EXPECT_LT((center - Vector3d(1, 2.1, 3)).norm(), 1e-9) << "the upper medians of -50, 0.9, 1 and 1.1, and so on";
    ASSERT_TRUE(result_.disagreement);
    EXPECT_NEAR(*result_.disagreement, 0.3, 1e-3) << "the median of 0, 0.1, 0.3, 0.4 and 50";
    EXPECT_EQ(result_.contradictory, std::vector<std::string>{"a.png"});
}

TEST_F(FacesOfPanoramas, AnImageThatIsNoFaceIsNamed) {
    add("a.png", 0, rotation_, {1, 2, 3});
    model_.images[0].name = "a.png/face6.jpg";
    try {
        written();
        FAIL();
    } catch (const DataError& e) {
        EXPECT_CONTAINS(e.what(), "model: image a.png/face6.jpg is no face of a panorama");
    }
}

}  // namespace
}  // namespace gs
