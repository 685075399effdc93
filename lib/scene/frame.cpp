// SPDX-License-Identifier: Apache-2.0
// Computes the point nearest to all optical axes, chooses frames, and converts cameras between scene and frame
// coordinates.
#include "lib/scene/frame.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

namespace gs {
namespace {

/// The typical size of scenes from COLMAP (4.2 to 5.6) and NeRF-synthetic (4.6 to 4.8), for which the defaults were
/// tuned.
constexpr double kUsualSize = 4.75;
/// The fraction of the cameras that determines the size, so that a wrong pose does not shrink the scene below the near
/// plane.
constexpr double kShare = 0.9;
/// Scenes keep their scale if their size differs from the usual size by at most this factor. In this range the scale
/// changes PSNR by about 0.1 dB (docs/stability.md).
constexpr double kUsualRange = 1.25;
/// Cameras nearly in one place determine the size poorly. The size is then at least this fraction (1/50) of the
/// distance to the points.
constexpr double kPointDistancePerSize = 50;
/// Beyond this distance from the origin, in sizes, the spacing of floats exceeds a millionth of a size.
constexpr double kFarFromOrigin = 16;
/// The scale of a scene in any unit lies between this value and its inverse.
constexpr double kSmallestScale = 1e-30;
/// Beyond this distance, in frame units, files store an offset: the spacing of floats is 2.4e-4 frame units there.
constexpr double kFileRange = 2048;

bool is_finite(const Eigen::Vector3d& p) { return p.allFinite() && p.cwiseAbs().maxCoeff() < 1e150; }

std::vector<Eigen::Vector3d> finite_only(std::vector<Eigen::Vector3d> points) {
    std::erase_if(points, [](const Eigen::Vector3d& p) { return !is_finite(p); });
    return points;
}

/// Returns the quantile `share` of the points' distances from `from`, or 0 without points.
double distance_quantile(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& from, double share) {
    if (points.empty()) return 0;
    std::vector<double> distances;
    for (const Eigen::Vector3d& p : points) distances.push_back((p - from).norm());
    const auto at = distances.begin() + std::ptrdiff_t(std::ceil(share * double(distances.size()))) - 1;
    std::nth_element(distances.begin(), at, distances.end());
    return *at;
}

/// Returns the mean of the points within `distance` of `from`.
Eigen::Vector3d mean_within(const std::vector<Eigen::Vector3d>& points, const Eigen::Vector3d& from, double distance) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    double count = 0;
    for (const Eigen::Vector3d& p : points)
        if ((p - from).norm() <= distance) mean += (p - mean) / ++count;
    return mean;
}

}  // namespace

Eigen::Vector3d common_target(const std::vector<View>& views) {
    Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero(), mean = b;
    for (const View& view : views) mean += view.camera.center() / double(views.size());
    for (const View& view : views) {
        const Eigen::Vector3d axis = view.camera.rotation.row(2);
        const Eigen::Matrix3d off_axis =
            Eigen::Matrix3d::Identity() - axis * axis.transpose() + 1e-6 * Eigen::Matrix3d::Identity();
        a += off_axis;
        b += off_axis * (view.camera.center() - mean);  // relative, so that map coordinates lose no precision
    }
    return mean + Eigen::Vector3d(a.ldlt().solve(b));
}

Eigen::Vector3d mean_axis(const std::vector<View>& views) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const View& view : views) mean += view.camera.rotation.row(2).transpose() / double(views.size());
    return mean;
}

Frame choose_frame(const std::vector<Eigen::Vector3d>& camera_centers, const std::vector<Eigen::Vector3d>& points) {
    Frame frame;
    const std::vector<Eigen::Vector3d> cameras = finite_only(camera_centers);
    if (cameras.empty()) return frame;
    const Eigen::Vector3d all = mean_within(cameras, cameras[0], std::numeric_limits<double>::infinity()),
                          mean = mean_within(cameras, all, distance_quantile(cameras, all, kShare));
    const double size = std::max(1.1 * distance_quantile(cameras, mean, kShare),
                                 distance_quantile(finite_only(points), mean, 0.5) / kPointDistancePerSize);
    // Cameras in one place differ only by the rounding of their coordinates, which is not a size.
    if (!(size > 1e-13 * mean.norm())) return frame;
    if (const double scale = kUsualSize / size; !(scale >= kSmallestScale && scale <= 1 / kSmallestScale)) return frame;
    if (!(size <= kUsualSize * kUsualRange && size >= kUsualSize / kUsualRange)) frame.scale = kUsualSize / size;
    if (mean.norm() > kFarFromOrigin * size) {
        // Rounds the centre to multiples of a power of two near the size: such numbers are short in files, and sums
        // with scene coordinates have little rounding error.
        const double step = std::exp2(std::floor(std::log2(size)));
        frame.center = (mean / step).array().round() * step;
    }
    return frame;
}

Camera into_frame(Camera camera, const Frame& frame) {
    if (frame.is_identity()) return camera;
    camera.translation = frame.scale * (camera.translation + camera.rotation * frame.center);
    return camera;
}

Camera out_of_frame(Camera camera, const Frame& frame) {
    if (frame.is_identity()) return camera;
    camera.translation = camera.translation / frame.scale - camera.rotation * frame.center;
    return camera;
}

Eigen::Vector3d file_offset(const Frame& frame) {
    return frame.scale * frame.center.norm() > kFileRange ? frame.center : Eigen::Vector3d::Zero();
}

std::string offset_comment(const Eigen::Vector3d& offset) {
    return fmt::format("{}{} {} {} (add it to x y z for the scene's own coordinates)", kOffsetComment, offset.x(),
                       offset.y(), offset.z());
}

std::string frame_text(const Frame& frame) {
    return fmt::format("center {} {} {} scale {}", frame.center.x(), frame.center.y(), frame.center.z(), frame.scale);
}

std::optional<Frame> parse_frame(const std::string& text) {
    std::istringstream words(text);
    std::string center, scale, rest;
    Frame frame;
    words >> center;
    for (double& x : frame.center) words >> x;
    words >> scale >> frame.scale;
    if (!words || words >> rest || center != "center" || scale != "scale") return std::nullopt;
    if (!is_finite(frame.center) || !(frame.scale >= kSmallestScale && frame.scale <= 1 / kSmallestScale))
        return std::nullopt;
    return frame;
}

nlohmann::ordered_json frame_json(const Frame& frame) {
    return {{"center", {frame.center.x(), frame.center.y(), frame.center.z()}}, {"scale", frame.scale}};
}

}  // namespace gs
