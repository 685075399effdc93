// SPDX-License-Identifier: Apache-2.0
#include "lib/scene/panorama.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numbers>
#include <set>
#include <string_view>
#include <utility>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/io/atomic_file.h"
#include "lib/io/image.h"
#include "lib/scene/view_builder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr double kRadians = std::numbers::pi / 180;
constexpr double kOutlier = 5 * kRadians;
constexpr std::string_view kSuffix = ".jpg";

std::string folder_of(int face) { return fmt::format("face{}/", face); }

/// Returns the rotation from a photograph's camera to that of a face: the face looks further to the right.
Eigen::Matrix3d face_from_whole(int face) {
    return Eigen::AngleAxisd(-2 * std::numbers::pi * face / kFaces, Eigen::Vector3d::UnitY()).toRotationMatrix();
}

Camera whole_camera(int width, int height) {
    const double size[2] = {double(width), double(height)};
    Camera camera;
    static_cast<LensCamera&>(camera) = make_lens_camera(CameraModel::kEquirectangular, width, height, size);
    camera.range.max_angle = std::numbers::pi;
    return camera;
}

Camera face_camera(int photograph_width) {
    const int size = int(std::lround(photograph_width / std::numbers::pi));
    Camera camera;
    camera.width = camera.height = size;
    camera.fx = camera.fy = camera.cx = camera.cy = 0.5 * size;
    return camera;
}

/// Returns the width of a photograph, or nothing if colmap could not read it either, as the log then says.
std::optional<int> checked_width(const fs::path& photograph) {
    ImageInfo info;
    try {
        info = read_image_info(photograph);
    } catch (const DataError& e) {
        log_warning("{}", e.what());
        return {};
    }
    if (std::abs(info.width - 2 * info.height) > 0.01 * info.width)
        throw DataError(
            fmt::format("image {}: is {}x{}; a photograph of 360 degrees (EQUIRECTANGULAR) is twice as wide as high",
                        photograph.string(), info.width, info.height));
    return info.width;
}

void write_faces_of(const fs::path& images, const std::string& photograph, const fs::path& folder) {
    ViewImage whole;
    try {
        whole.color = read_image(images / photograph);
    } catch (const DataError& e) {
        log_warning("{}", e.what());
        return;
    }
    const Camera camera = whole_camera(whole.color.width, whole.color.height);
    for (int face = 0; face < kFaces; ++face) {
        const Eigen::Matrix3d whole_from_face = face_from_whole(face).transpose();
        const fs::path path = folder / face_name(photograph, face);
        write_image(path, undistort(whole, camera, face_camera(camera.width), whole_from_face).color);
    }
}

struct Pose {
    Eigen::Quaterniond rotation;  ///< cam_from_world
    Eigen::Vector3d center;       ///< scene units
};

/// Returns the index of the pose whose position is nearest to all others.
std::size_t middle(const std::vector<Pose>& poses) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < poses.size(); ++i) {
        double sum = 0;
        for (const Pose& other : poses) sum += (other.center - poses[i].center).norm();
        if (sum < least) best = i, least = sum;
    }
    return best;
}

Pose mean(const std::vector<Pose>& poses) {
    const Eigen::Quaterniond chosen = poses[middle(poses)].rotation;
    Eigen::Vector4d rotation = Eigen::Vector4d::Zero();
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    int count = 0;
    for (const Pose& pose : poses) {
        if (chosen.angularDistance(pose.rotation) > kOutlier) continue;
        rotation += std::copysign(1.0, chosen.dot(pose.rotation)) * pose.rotation.coeffs();
        center += pose.center;
        ++count;
    }
    return {Eigen::Quaterniond(rotation.normalized()), center / count};
}

/// Returns the poses of photographs that the faces state, by the photograph's name.
std::map<std::string, std::vector<Pose>> stated_poses(const ColmapModel& faces) {
    std::map<std::string, std::vector<Pose>> poses;
    for (const ColmapImage& image : faces.images) {
        int face = 0;
        while (face < kFaces && !image.name.starts_with(folder_of(face))) ++face;
        if (face == kFaces || !image.name.ends_with(kSuffix))
            throw DataError(fmt::format("{}: image {} is no face of a photograph", faces.folder.string(), image.name));
        const std::size_t before = folder_of(face).size();
        const std::string photograph = image.name.substr(before, image.name.size() - before - kSuffix.size());
        poses[photograph].push_back({Eigen::Quaterniond(face_from_whole(face).transpose() * image.rotation),
                                     -image.rotation.transpose() * image.translation});
    }
    return poses;
}

void write_points(const SourcePoints& points, const fs::path& path) {
    AtomicFile file(path);
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        const Eigen::Vector3d& p = points.positions[i];
        const Eigen::Vector3f color = points.colors[i] * 255.0f;
        file.stream() << fmt::format("{} {} {} {} {:.0f} {:.0f} {:.0f} 0\n", i + 1, p.x(), p.y(), p.z(), color.x(),
                                     color.y(), color.z());
    }
    file.commit();
}

}  // namespace

std::string face_name(const std::string& photograph, int face) {
    return folder_of(face) + photograph + std::string(kSuffix);
}

std::string write_faces(const fs::path& images, const std::vector<std::string>& photographs, const fs::path& folder,
                        const std::function<void(std::size_t done)>& progress) {
    std::set<int> widths;
    for (const std::string& photograph : photographs)
        if (const auto width = checked_width(images / photograph)) widths.insert(*width);
    std::size_t done = 0;
    std::mutex counting;
    parallel_for(std::int64_t(photographs.size()), [&](std::int64_t i) {
        if (interrupted()) return;
        write_faces_of(images, photographs[std::size_t(i)], folder);
        const std::lock_guard lock(counting);
        progress(++done);
    });
    if (interrupted()) throw Interrupted("stopped while faces of the photographs were written");
    if (widths.size() != 1) return "";
    const Camera camera = face_camera(*widths.begin());
    return fmt::format("{},{},{}", camera.fx, camera.cx, camera.cy);
}

WholeModel write_whole_model(const ColmapModel& faces, const fs::path& images, const fs::path& folder) {
    WholeModel model;
    std::map<std::pair<int, int>, int> cameras;
    std::string image_lines, camera_lines;
    std::vector<double> angles;
    for (const auto& [photograph, poses] : stated_poses(faces)) {
        const ImageInfo info = read_image_info(images / photograph);
        const auto [camera, is_new] =
            cameras.try_emplace({info.width, info.height}, int(cameras.size()) + 1);
        if (is_new)
            camera_lines += fmt::format("{0} EQUIRECTANGULAR {1} {2} {1} {2}\n", camera->second, info.width, info.height);
        const Pose pose = mean(poses);
        if (poses.size() > 1)
            for (const Pose& face : poses) angles.push_back(pose.rotation.angularDistance(face.rotation) / kRadians);
        const Eigen::Quaterniond& q = pose.rotation;
        const Eigen::Vector3d t = -(q * pose.center);
        model.photographs.push_back(photograph);
        image_lines += fmt::format("{} {} {} {} {} {} {} {} {} {}\n\n", model.photographs.size(), q.w(), q.x(), q.y(),
                                   q.z(), t.x(), t.y(), t.z(), camera->second, photograph);
    }
    if (!angles.empty()) {
        std::nth_element(angles.begin(), angles.begin() + angles.size() / 2, angles.end());
        model.disagreement = angles[angles.size() / 2];
    }
    write_text_atomic(folder / "cameras.txt", camera_lines);
    write_text_atomic(folder / "images.txt", image_lines);
    write_points(faces.points, folder / "points3D.txt");
    return model;
}

}  // namespace gs
