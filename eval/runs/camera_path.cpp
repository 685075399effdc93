// SPDX-License-Identifier: Apache-2.0
// Reads camera paths from JSON and fits orbits to the training cameras.
#include "eval/runs/camera_path.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "kernels/core/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/scene/common_target.h"

namespace gs {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Camera camera_from_json(const nlohmann::json& json, const std::string& where, const Frame& frame) {
    const auto positive = [&](const char* key) {
        const double value = json.at(key).get<double>();
        if (!(value > 0 && value < 1e6)) throw DataError(fmt::format("{}: {} is {}", where, key, value));
        return value;
    };
    try {
        Camera camera;
        camera.width = int(positive("width"));
        camera.height = int(positive("height"));
        // A few bytes must not ask for the whole memory; the largest photographs have some 100 million pixels.
        constexpr std::int64_t kMaxPixels = 1 << 27;
        if (camera.width < 1 || camera.height < 1 || std::int64_t(camera.width) * camera.height > kMaxPixels)
            throw DataError(fmt::format("{}: {}x{} is no size for a picture; it may have 1 to {} pixels", where,
                                        camera.width, camera.height, kMaxPixels));
        camera.fy = positive("fy");
        camera.fx = json.contains("fx") ? positive("fx") : camera.fy;
        camera.cx = 0.5 * camera.width;
        camera.cy = 0.5 * camera.height;
        Matrix3d world_from_camera;
        Vector3d position;
        for (int r = 0; r < 3; ++r) {
            position[r] = json.at("position").at(r).get<double>();
            for (int c = 0; c < 3; ++c) world_from_camera(r, c) = json.at("rotation").at(r).at(c).get<double>();
        }
        const double error = (world_from_camera * world_from_camera.transpose() - Matrix3d::Identity()).norm();
        if (!(error < 1e-3) || !position.allFinite())
            throw DataError(fmt::format("{}: 'rotation' is no rotation, or 'position' is not finite", where));
        if (json.contains("offset"))
            for (int r = 0; r < 3; ++r) position[r] += json.at("offset").at(r).get<double>();
        camera.rotation = world_from_camera.transpose();
        camera.translation = -camera.rotation * frame.from_scene(position);
        return camera;
    } catch (const nlohmann::json::exception& e) {
        throw DataError(fmt::format("{}: {}", where, e.what()));
    }
}

}  // namespace

std::vector<Camera> read_camera_path(const std::filesystem::path& path, const Frame& frame) {
    std::ifstream file = open_input(path);
    nlohmann::json json;
    try {
        json = parse_json(file);
    } catch (const nlohmann::json::exception& e) {
        throw DataError(fmt::format("{}: not a JSON list of cameras: {}", path.string(), e.what()));
    }
    if (!json.is_array() || json.empty()) throw DataError(fmt::format("{}: not a JSON list of cameras", path.string()));
    std::vector<Camera> cameras;
    for (std::size_t i = 0; i < json.size(); ++i)
        cameras.push_back(camera_from_json(json[i], fmt::format("{}: entry {}", path.string(), i), frame));
    return cameras;
}

std::vector<Camera> orbit_path(const std::vector<View>& views, int count) {
    if (views.empty()) throw UsageError("an orbit needs the cameras of at least one view");
    if (count < 1) throw UsageError(fmt::format("--orbit: {} is below 1", count));
    const Vector3d target = common_target(views);
    Vector3d up = Vector3d::Zero();
    for (const View& view : views) up -= view.camera.rotation.row(1).transpose();
    up = up.norm() > 1e-9 ? up.normalized() : Vector3d::UnitZ();
    double height = 0, radius = 0;
    for (const View& view : views) {
        const Vector3d offset = view.camera.center() - target;
        height += offset.dot(up) / double(views.size());
        radius += (offset - offset.dot(up) * up).norm() / double(views.size());
    }
    // The orbit starts where the first camera stands, or anywhere if that stands on the axis.
    Vector3d start = views[0].camera.center() - target;
    start -= start.dot(up) * up;
    if (start.norm() < 1e-9) start = up.unitOrthogonal();
    const Vector3d e0 = start.normalized(), e1 = up.cross(e0);
    if (radius < 1e-6) radius = 1;  // all cameras are above or below the target
    std::vector<Camera> cameras;
    for (int i = 0; i < count; ++i) {
        const double angle = 2 * M_PI * i / count;
        const Vector3d offset = radius * (std::cos(angle) * e0 + std::sin(angle) * e1) + height * up;
        const Vector3d forward = -offset.normalized(), right = forward.cross(up).normalized();
        Camera camera = views[0].camera;
        camera.rotation.row(0) = right;
        camera.rotation.row(1) = forward.cross(right);
        camera.rotation.row(2) = forward;
        camera.translation = -camera.rotation * (target + offset);
        cameras.push_back(camera);
    }
    return cameras;
}

}  // namespace gs
