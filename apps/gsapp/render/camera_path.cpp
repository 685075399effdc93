// SPDX-License-Identifier: Apache-2.0
// Checks image sizes, and reads camera paths from JSON. Every field is checked and errors name it, because such files
// are written by hand.
#include "apps/gsapp/render/camera_path.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"
#include "lib/core/log.h"
#include "lib/io/image.h"
#include "lib/model/cameras_json.h"
#include "lib/scene/frame.h"
#include "lib/scene/image_files.h"
#include "lib/scene/resized.h"
#include "lib/scene/transforms_reader.h"
#include "lib/scene/view_builder.h"

namespace gs {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using nlohmann::json;

/// One object of the file, and its name in messages.
struct Entry {
    const json& object;
    std::string where;

    [[noreturn]] void fail(const std::string& reason) const { throw DataError(fmt::format("{}: {}", where, reason)); }

    const json& at(const char* key) const {
        if (!object.is_object()) fail("it is no JSON object");
        const auto found = object.find(key);
        if (found == object.end()) fail(fmt::format("'{}' is missing", key));
        return *found;
    }
    double number(const json& value, const char* key) const {
        if (!value.is_number()) fail(fmt::format("'{}' is {}, not a number", key, json_text(value)));
        return value.get<double>();
    }
    double number(const char* key) const { return number(at(key), key); }
    double number_within(const char* key, double low, double high) const {
        const double value = number(key);
        if (!(value > low && value < high))
            fail(fmt::format("{} is {}; it has to be above {} and below {}", key, value, low, high));
        return value;
    }
    /// Returns a list of `count` numbers, none so large that arithmetic could overflow.
    std::vector<double> numbers(const json& list, const char* key, std::size_t count) const {
        if (!list.is_array() || list.size() != count) fail(fmt::format("'{}' is no list of {} numbers", key, count));
        std::vector<double> values;
        for (const json& value : list) {
            values.push_back(number(value, key));
            if (!(std::abs(values.back()) < 1e30)) fail(fmt::format("'{}' has {}", key, values.back()));
        }
        return values;
    }
    Vector3d vector(const char* key) const { return Vector3d(numbers(at(key), key, 3).data()); }

    void set_size(Camera& camera, const char* width_key, const char* height_key) const {
        const double width = number(width_key), height = number(height_key);
        const auto size = picture_size(width, height);
        if (!size)
            fail(fmt::format("{} is {} and {} is {}; {}", width_key, width, height_key, height, picture_size_limits()));
        camera.width = size->width, camera.height = size->height;
        camera.cx = 0.5 * camera.width, camera.cy = 0.5 * camera.height;
    }
    /// Sets the pose from the camera's axes in the world (x right, y down, z forward) and its position, in scene units.
    void set_pose(Camera& camera, const Matrix3d& axes, const Vector3d& position, const char* key,
                  const Frame& frame) const {
        if (!((axes * axes.transpose() - Matrix3d::Identity()).norm() < 1e-3 && axes.determinant() > 0))
            fail(fmt::format("'{}' is no rotation: its columns have to be perpendicular, of length 1 and right-handed",
                             key));
        camera.rotation = axes.transpose();
        camera.translation = -camera.rotation * frame.from_scene(position);
    }
};

Camera camera_of_list(const Entry& entry, const Frame& frame) {
    Camera camera;
    entry.set_size(camera, "width", "height");
    camera.fy = entry.number_within("fy", 0, 1e6);
    camera.fx = entry.object.contains("fx") ? entry.number_within("fx", 0, 1e6) : camera.fy;
    if (entry.object.contains("cx")) camera.cx = entry.number_within("cx", -1e6, 1e6);
    if (entry.object.contains("cy")) camera.cy = entry.number_within("cy", -1e6, 1e6);
    try {
        set_listed_lens(entry.object, camera);
        if (!is_pinhole(camera)) camera.range = lens_range(camera);
    } catch (const std::exception& e) {
        entry.fail(e.what());
    }
    Vector3d position = entry.vector("position");
    if (entry.object.contains("offset")) position += entry.vector("offset");
    const json& rows = entry.at("rotation");
    if (!rows.is_array() || rows.size() != 3) entry.fail("'rotation' is no list of 3 rows");
    Matrix3d axes;
    for (int r = 0; r < 3; ++r) axes.row(r) = Vector3d(entry.numbers(rows[std::size_t(r)], "rotation", 3).data());
    entry.set_pose(camera, axes, position, "rotation", frame);
    return camera;
}

Camera camera_of_nerfstudio(const Entry& entry, Camera camera, const Frame& frame) {
    const double half_angle = entry.number_within("fov", 0, 180) * M_PI / 360;
    camera.fx = camera.fy = 0.5 * camera.height / std::tan(half_angle);
    const std::vector<double> m = entry.numbers(entry.at("camera_to_world"), "camera_to_world", 16);
    Eigen::Matrix4d world_from_camera = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(m.data());
    if (!(world_from_camera.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).isZero(1e-6))
        entry.fail("the last row of 'camera_to_world' is not 0 0 0 1");
    Matrix3d axes = world_from_camera.topLeftCorner<3, 3>();
    axes.col(1) *= -1, axes.col(2) *= -1;  // from y up and viewing direction -z
    entry.set_pose(camera, axes, world_from_camera.topRightCorner<3, 1>(), "camera_to_world", frame);
    return camera;
}

CameraPath path_of_list(const json& list, const std::string& file, const Frame& frame) {
    if (list.empty()) throw DataError(fmt::format("{}: the list of cameras is empty", file));
    CameraPath path;
    for (std::size_t i = 0; i < list.size(); ++i)
        path.cameras.push_back(camera_of_list({list[i], fmt::format("{}: entry {}", file, i)}, frame));
    return path;
}

CameraPath path_of_nerfstudio(const json& object, const std::string& file, const Frame& frame) {
    const Entry whole{object, file};
    if (const auto type = object.find("camera_type"); type != object.end() && *type != "perspective")
        whole.fail(fmt::format("'camera_type' is {}; only perspective cameras can be rendered", json_text(*type)));
    Camera camera;
    whole.set_size(camera, "render_width", "render_height");
    CameraPath path;
    if (object.contains("fps")) path.fps = whole.number_within("fps", kLeastFps, kMostFps);
    const json& list = whole.at("camera_path");
    if (!list.is_array() || list.empty()) whole.fail("'camera_path' is no list of cameras, or an empty one");
    for (std::size_t i = 0; i < list.size(); ++i)
        path.cameras.push_back(
            camera_of_nerfstudio({list[i], fmt::format("{}: camera_path entry {}", file, i)}, camera, frame));
    return path;
}

/// Returns the size of a frame's image, whose name may lack the extension; empty without an image.
std::optional<PictureSize> image_size(const std::filesystem::path& image) {
    const auto size = [](const std::filesystem::path& path) {
        const ImageInfo info = read_image_info(path);
        return PictureSize{info.width, info.height};
    };
    if (names_file(image)) return size(image);
    for (const std::string_view extension : kImageExtensions)
        if (const std::filesystem::path file = image.string() + std::string(extension); names_file(file))
            return size(file);
    return std::nullopt;
}

CameraPath path_of_transforms(const std::filesystem::path& path, const Frame& frame) {
    const TransformsFile file = read_transforms(path);
    if (file.frames.empty()) throw DataError(fmt::format("{}: 'frames' is an empty list", path.string()));
    CameraPath cameras;
    for (std::size_t i = 0; i < file.frames.size(); ++i) {
        const TransformsFrame& entry = file.frames[i];
        const std::string where = fmt::format("{}: frame {}", path.string(), i);
        std::optional<PictureSize> size;
        if (entry.intrinsics.width && entry.intrinsics.height)
            size = picture_size(*entry.intrinsics.width, *entry.intrinsics.height);
        else
            size = image_size(path.parent_path() / entry.file_path);
        if (!size)
            throw DataError(
                fmt::format("{}: 'w' and 'h' are missing or no size of a picture, and there is no image "
                            "'{}' that has one; {}",
                            where, entry.file_path, picture_size_limits()));
        const LensCamera lens = resolve_intrinsics(entry.intrinsics, size->width, size->height, where);
        Camera camera = choose_camera(lens, LensMode::kNative, where);
        camera.rotation = entry.rotation, camera.translation = entry.translation;
        cameras.cameras.push_back(into_frame(camera, frame));
    }
    return cameras;
}

}  // namespace

std::optional<PictureSize> picture_size(double width, double height) {
    const auto is_side = [](double side) { return side >= 1 && side <= kMaxPictureSide && side == std::floor(side); };
    if (!is_side(width) || !is_side(height) || width * height > kMaxPicturePixels) return std::nullopt;
    return PictureSize{int(width), int(height)};
}

std::string picture_size_limits() {
    return fmt::format("a picture has 1 to {} whole pixels a side and at most {}", kMaxPictureSide, kMaxPicturePixels);
}

PictureSize parse_picture_size(const std::string& text) {
    int width = 0, height = 0;
    const char* end = text.data() + text.size();
    const auto [cross, error] = std::from_chars(text.data(), end, width);
    if (error == std::errc{} && cross != end && *cross == 'x')
        if (const auto [last, wrong] = std::from_chars(cross + 1, end, height); wrong == std::errc{} && last == end)
            if (const auto size = picture_size(width, height)) return *size;
    throw UsageError(fmt::format("--size {}: it is WIDTHxHEIGHT, such as 1280x720; {}", text, picture_size_limits()));
}

Camera with_vertical_field(Camera camera, const PictureSize& size) {
    if (camera.model == CameraModel::kEquirectangular) return resized(camera, size.width, size.height);
    const double scale = double(size.height) / camera.height;
    camera.fx *= scale, camera.fy *= scale, camera.cy *= scale;
    camera.cx = 0.5 * size.width + scale * (camera.cx - 0.5 * camera.width);
    camera.width = size.width, camera.height = size.height;
    return camera;
}

CameraPath read_camera_path(const std::filesystem::path& path, const Frame& frame) {
    const std::string text = read_input(path);
    json content;
    try {
        content = parse_json(text);
    } catch (const json::exception& e) {
        throw DataError(fmt::format("{}: not a JSON list of cameras: {}", path.string(), e.what()));
    }
    if (content.is_array()) return path_of_list(content, path.string(), frame);
    if (content.is_object() && content.contains("camera_path"))
        return path_of_nerfstudio(content, path.string(), frame);
    if (content.is_object() && content.contains("frames")) return path_of_transforms(path, frame);
    throw DataError(
        fmt::format("{}: neither a list of cameras as in cameras.json nor nerfstudio's camera_path.json nor a "
                    "transforms.json",
                    path.string()));
}

}  // namespace gs
