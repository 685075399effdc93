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
#include <utility>

#include "kernels/base/error.h"
#include "kernels/base/parallel.h"
#include "lib/core/interrupt.h"
#include "lib/core/log.h"
#include "lib/core/median.h"
#include "lib/io/image.h"
#include "lib/scene/colmap_writer.h"
#include "lib/scene/view_builder.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
constexpr double kRadians = std::numbers::pi / 180;
// Faces of one panorama that colmap placed rightly differ by some hundredths of a degree.
constexpr double kOutlier = 5 * kRadians;

/// Returns the rotation from a panorama's camera to that of a face: the face looks further to the right.
Eigen::Matrix3d face_from_panorama(int face) {
    const double angle = 2 * std::numbers::pi * face / kPanoramaFaces;
    return Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()).toRotationMatrix();
}

Camera face_camera(int panorama_width) {
    const int size = int(std::lround(panorama_width / std::numbers::pi));
    Camera camera;
    camera.width = camera.height = size;
    camera.fx = camera.fy = camera.cx = camera.cy = 0.5 * size;
    return camera;
}

/// Returns the width of a panorama, or nothing, after a warning, if the file cannot be read.
std::optional<int> checked_width(const fs::path& panorama) {
    ImageInfo info;
    try {
        info = read_image_info(panorama);
    } catch (const DataError& e) {
        log_warning("{}", e.what());
        return {};
    }
    if (std::abs(info.width - 2 * info.height) > 0.01 * info.width)
        throw DataError(
            fmt::format("image {}: is {}x{}; a photograph of 360 degrees (EQUIRECTANGULAR) is twice as wide as high",
                        panorama.string(), info.width, info.height));
    return info.width;
}

void write_faces_of(const fs::path& images, const std::string& name, const Camera& pinhole, const fs::path& folder) {
    ViewImage panorama;
    try {
        panorama.color = read_image(images / name);
    } catch (const DataError& e) {
        log_warning("{}", e.what());
        return;
    }
    const double size[2] = {double(panorama.color.width), double(panorama.color.height)};
    const Camera camera = choose_camera(
        make_lens_camera(CameraModel::kEquirectangular, panorama.color.width, panorama.color.height, size),
        LensMode::kNative, name);
    for (int face = 0; face < kPanoramaFaces; ++face) {
        const Eigen::Matrix3d panorama_from_face = face_from_panorama(face).transpose();
        write_image(folder / face_name(name, face), undistort(panorama, camera, pinhole, panorama_from_face).color);
    }
}

struct Pose {
    Eigen::Quaterniond rotation;  ///< cam_from_world
    Eigen::Vector3d center;       ///< scene units
};

/// Returns the pose with the least sum of distances to the others.
const Pose& medoid(const std::vector<Pose>& poses) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < poses.size(); ++i) {
        double sum = 0;
        for (const Pose& other : poses) sum += (other.center - poses[i].center).norm();
        if (sum < least) best = i, least = sum;
    }
    return poses[best];
}

/// Returns the pose of a panorama, and sets `contradictory` if a face was left out.
Pose combined(const std::vector<Pose>& poses, bool& contradictory) {
    const Eigen::Quaterniond& chosen = medoid(poses).rotation;
    Eigen::Vector4d rotation = Eigen::Vector4d::Zero();
    std::vector<double> centers[3];
    for (const Pose& pose : poses) {
        if (chosen.angularDistance(pose.rotation) > kOutlier) {
            contradictory = true;
            continue;
        }
        rotation += std::copysign(1.0, chosen.dot(pose.rotation)) * pose.rotation.coeffs();
        for (int k = 0; k < 3; ++k) centers[k].push_back(pose.center[k]);
    }
    return {Eigen::Quaterniond(rotation.normalized()), {median(centers[0]), median(centers[1]), median(centers[2])}};
}

/// Returns the poses that its faces state, by panorama.
std::map<std::string, std::vector<Pose>> poses_by_panorama(const ColmapModel& faces) {
    std::map<std::string, std::vector<Pose>> poses;
    for (const ColmapImage& image : faces.images) {
        int face = 0;
        while (face < kPanoramaFaces && !image.name.ends_with(face_name("", face))) ++face;
        if (face == kPanoramaFaces)
            throw DataError(fmt::format("{}: image {} is no face of a panorama", faces.folder.string(), image.name));
        const std::string panorama = image.name.substr(0, image.name.size() - face_name("", face).size());
        poses[panorama].push_back({Eigen::Quaterniond(face_from_panorama(face).transpose() * image.rotation),
                                   -image.rotation.transpose() * image.translation});
    }
    return poses;
}

}  // namespace

std::string face_name(const std::string& panorama, int face) { return fmt::format("{}/face{}.jpg", panorama, face); }

std::string write_faces(const fs::path& images, const std::vector<std::string>& panoramas, const fs::path& folder,
                        const std::function<void(std::size_t done, std::size_t all)>& progress) {
    std::vector<std::string> readable;
    int largest_width = 0;
    for (const std::string& name : panoramas) {
        const std::optional<int> width = checked_width(images / name);
        if (!width) continue;
        readable.push_back(name);
        largest_width = std::max(largest_width, *width);
    }
    const Camera pinhole = face_camera(largest_width);
    std::size_t done = 0;
    std::mutex counting;
    parallel_for(std::int64_t(readable.size()), [&](std::int64_t i) {
        if (interrupted()) return;
        write_faces_of(images, readable[std::size_t(i)], pinhole, folder);
        const std::lock_guard lock(counting);
        progress(++done, readable.size());
    });
    if (interrupted()) throw Interrupted("stopped while faces of the panoramas were written");
    return fmt::format("{},{},{}", pinhole.fx, pinhole.cx, pinhole.cy);
}

PanoramaModel write_panorama_model(const ColmapModel& faces, const fs::path& images, const fs::path& folder) {
    PanoramaModel model;
    std::vector<PosedImage> posed;
    std::vector<double> angles;
    for (const auto& [name, poses] : poses_by_panorama(faces)) {
        const ImageInfo info = read_image_info(images / name);
        const double size[2] = {double(info.width), double(info.height)};
        bool contradictory = false;
        const Pose pose = combined(poses, contradictory);
        if (contradictory) model.contradictory.push_back(name);
        if (poses.size() > 1)
            for (const Pose& face : poses) angles.push_back(pose.rotation.angularDistance(face.rotation) / kRadians);
        model.panoramas.push_back(name);
        posed.push_back({name, make_lens_camera(CameraModel::kEquirectangular, info.width, info.height, size),
                         pose.rotation.toRotationMatrix(), -(pose.rotation * pose.center)});
    }
    if (!angles.empty()) model.disagreement = median(std::move(angles));
    write_colmap_model(folder, posed, faces.points);
    return model;
}

}  // namespace gs
