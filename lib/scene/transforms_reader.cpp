// SPDX-License-Identifier: Apache-2.0
// Reads transforms*.json of NeRF-synthetic, instant-ngp and nerfstudio into plain structs.
#include "lib/scene/transforms_reader.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "kernels/base/error.h"
#include "lib/core/input_file.h"
#include "lib/core/json_text.h"

namespace gs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

/// Returns a value as shortened text for a message.
std::string shown(const json& value) {
    std::string text = json_text(value);
    return text.size() > 60 ? text.substr(0, 60) + "..." : text;
}

/// A JSON object together with its place in the file, for messages.
class Object {
  public:
    Object(const json& value, std::string where) : value_(value), where_(std::move(where)) {
        if (!value.is_object()) throw DataError(fmt::format("{}: must be an object but is {}", where_, shown(value)));
    }

    const std::string& where() const { return where_; }

    const json* find(const char* key) const {
        const auto it = value_.find(key);
        return it == value_.end() || it->is_null() ? nullptr : &*it;
    }

    std::optional<double> number(const char* key) const {
        const json* value = find(key);
        if (!value) return {};
        if (!value->is_number()) fail(key, "a number", *value);
        return value->get<double>();
    }

    std::optional<double> positive(const char* key) const {
        const std::optional<double> value = number(key);
        if (value && !(*value > 0)) fail(key, "positive", *find(key));
        return value;
    }

    /// Reads a field of view and returns it in radians. `to_radians` is the factor from the file's unit.
    std::optional<double> angle(const char* key, double to_radians) const {
        const std::optional<double> value = number(key);
        if (!value) return {};
        if (!(*value > 0 && *value * to_radians < std::numbers::pi))
            fail(key, "an angle between 0 and 180 degrees", *find(key));
        return *value * to_radians;
    }

    std::optional<std::string> text(const char* key) const {
        const json* value = find(key);
        if (!value) return {};
        if (!value->is_string()) fail(key, "a string", *value);
        return value->get<std::string>();
    }

    bool flag(const char* key) const {
        const json* value = find(key);
        if (!value) return false;
        if (!value->is_boolean() && !value->is_number()) fail(key, "true or false", *value);
        return value->is_boolean() ? value->get<bool>() : value->get<double>() != 0;
    }

    const json& required(const char* key) const {
        const json* value = find(key);
        if (!value) throw DataError(fmt::format("{}: key '{}' is missing", where_, key));
        return *value;
    }

    [[noreturn]] void fail(const char* key, const char* expected, const json& value) const {
        throw DataError(fmt::format("{}: key '{}' must be {} but is {}", where_, key, expected, shown(value)));
    }

  private:
    const json& value_;
    std::string where_;
};

std::string normal_path(std::string path) {
    std::replace(path.begin(), path.end(), '\\', '/');
    return fs::path(path).lexically_normal().generic_string();
}

std::optional<int> size(const Object& object, const char* key) {
    const std::optional<double> value = object.number(key);
    if (!value) return {};
    if (!(*value >= 1 && *value < (1 << 20))) object.fail(key, "an image size in pixels", *object.find(key));
    return int(*value);
}

/// Returns the frame's value, or else the file's value.
template <class Get> auto inherited(const Object& frame, const Object& file, Get get) {
    auto value = get(frame);
    return value ? value : get(file);
}

/// Reads the focal length of one level; returns true if there is one.
bool read_focal(const Object& object, TransformsIntrinsics& out) {
    out.focal_x = object.positive("fl_x");
    out.focal_y = object.positive("fl_y");
    if (out.focal_x || out.focal_y) return true;
    constexpr double kDegree = std::numbers::pi / 180;
    out.angle_x = object.angle("camera_angle_x", 1);
    out.angle_y = object.angle("camera_angle_y", 1);
    if (!out.angle_x) out.angle_x = object.angle("x_fov", kDegree);
    if (!out.angle_y) out.angle_y = object.angle("y_fov", kDegree);
    return out.angle_x || out.angle_y;
}

void reject_other_lenses(const Object& frame, const Object& file) {
    for (const Object* object : {&frame, &file}) {
        for (const char* key : {"latlong", "equirectangular", "orthographic"})
            if (object->flag(key))
                throw DataError(fmt::format("{}: lens '{}' is unsupported; use perspective or OpenCV images",
                                            object->where(), key));
        if (object->find("ftheta_p0"))
            throw DataError(
                fmt::format("{}: lens 'ftheta' is unsupported; use perspective or OpenCV images", object->where()));
    }
}

void read_lens(const Object& frame, const Object& file, TransformsIntrinsics& out) {
    reject_other_lenses(frame, file);
    const auto coefficient = [&](const char* key) {
        return inherited(frame, file, [&](const Object& o) { return o.number(key); }).value_or(0);
    };
    const double k1 = coefficient("k1"), k2 = coefficient("k2"), k3 = coefficient("k3"), k4 = coefficient("k4");
    const double p1 = coefficient("p1"), p2 = coefficient("p2");
    const std::string model =
        inherited(frame, file, [](const Object& o) { return o.text("camera_model"); }).value_or("");
    static constexpr const char* kPerspective[] = {"",        "PERSPECTIVE",    "OPENCV", "FULL_OPENCV",
                                                   "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL"};
    const bool fisheye = model == "OPENCV_FISHEYE" || frame.flag("is_fisheye") || file.flag("is_fisheye");
    if (fisheye) {
        out.model = CameraModel::kOpenCVFisheye;
        out.distortion = {k1, k2, k3, k4};
        return;
    }
    if (std::find(std::begin(kPerspective), std::end(kPerspective), model) == std::end(kPerspective))
        throw DataError(fmt::format(
            "{}: camera_model '{}' is unsupported; known are PERSPECTIVE, PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, "
            "RADIAL, OPENCV, FULL_OPENCV and OPENCV_FISHEYE",
            frame.where(), model));
    if (k4 != 0)
        throw DataError(fmt::format("{}: k4 is {:g}, but only fisheye lenses have a k4 here", frame.where(), k4));
    if (k3 != 0) {
        out.model = CameraModel::kFullOpenCV;
        out.distortion = {k1, k2, p1, p2, k3};
    } else if (k1 != 0 || k2 != 0 || p1 != 0 || p2 != 0) {
        out.model = CameraModel::kOpenCV;
        out.distortion = {k1, k2, p1, p2};
    }
}

TransformsIntrinsics read_intrinsics(const Object& frame, const Object& file) {
    TransformsIntrinsics out;
    out.width = inherited(frame, file, [](const Object& o) { return size(o, "w"); });
    out.height = inherited(frame, file, [](const Object& o) { return size(o, "h"); });
    out.cx = inherited(frame, file, [](const Object& o) { return o.number("cx"); });
    out.cy = inherited(frame, file, [](const Object& o) { return o.number("cy"); });
    if (!read_focal(frame, out)) read_focal(file, out);
    read_lens(frame, file, out);
    return out;
}

/// Converts a camera-to-world matrix with OpenGL axes to cam_from_world with OpenCV axes. Returns true if the matrix
/// has a scale.
bool read_pose(const Object& frame, TransformsFrame& out) {
    constexpr const char* kKey = "transform_matrix";
    const json& rows = frame.required(kKey);
    if (!rows.is_array() || (rows.size() != 3 && rows.size() != 4)) frame.fail(kKey, "3 or 4 rows of 4 numbers", rows);
    Eigen::Matrix<double, 3, 4> c2w;
    for (int r = 0; r < 3; ++r) {
        if (!rows[r].is_array() || rows[r].size() != 4) frame.fail(kKey, "3 or 4 rows of 4 numbers", rows[r]);
        for (int c = 0; c < 4; ++c) {
            if (!rows[r][c].is_number()) frame.fail(kKey, "3 or 4 rows of 4 numbers", rows[r][c]);
            c2w(r, c) = rows[r][c].get<double>();
        }
    }
    Eigen::Matrix3d axes = c2w.leftCols<3>();
    const double scale = axes.colwise().stableNorm().mean();
    if (!c2w.allFinite() || !(scale > 1e-12) || !std::isfinite(scale))
        frame.fail(kKey, "a finite rigid transform", rows);
    axes /= scale;
    const Eigen::Matrix3d gram = axes.transpose() * axes;
    // Published matrices are rounded to 6 digits or more, so a deviation of two percent is damage or a shear.
    if (!(gram - Eigen::Matrix3d::Identity()).isZero(0.02) || axes.determinant() < 0)
        frame.fail(kKey, "a rotation (no shear, no mirroring) and a translation", rows);
    Eigen::Matrix3d rotation = Eigen::Quaterniond(axes).normalized().toRotationMatrix();
    rotation.rightCols<2>() *= -1;  // OpenGL: y up, z backward; OpenCV: y down, z forward
    out.rotation = rotation.transpose();
    out.translation = -out.rotation * c2w.col(3);
    if (!out.translation.allFinite()) frame.fail(kKey, "a finite rigid transform", rows);
    return std::abs(scale - 1) > 0.01;
}

std::optional<std::vector<std::string>> read_names(const Object& object, const char* key) {
    const json* value = object.find(key);
    if (!value) return {};
    if (!value->is_array()) object.fail(key, "a list of file names", *value);
    std::vector<std::string> names;
    for (const json& name : *value) {
        if (!name.is_string()) object.fail(key, "a list of file names", name);
        names.push_back(normal_path(name.get<std::string>()));
    }
    return names;
}

/// Reads one frame. Returns true if its matrix has a scale.
bool read_frame(const Object& frame, const Object& file, TransformsFrame& out) {
    frame.required("file_path");
    out.file_path = normal_path(*frame.text("file_path"));
    if (out.file_path.empty() || out.file_path.find('\0') != std::string::npos)
        frame.fail("file_path", "a file name", *frame.find("file_path"));
    if (const auto mask = frame.text("mask_path"); mask && !mask->empty()) out.mask_path = normal_path(*mask);
    out.is_bad = frame.flag("is_bad");
    out.intrinsics = read_intrinsics(frame, file);
    return read_pose(frame, out);
}

/// Reads a list of frames. Leaves out unusable frames, and throws DataError if no usable frame remains. Counts in
/// `scaled` the frames whose matrix has a scale.
void read_frames(const Object& file, const char* key, std::vector<TransformsFrame>& out, std::size_t& scaled,
                 std::vector<std::string>& notes) {
    const json& frames = file.required(key);
    if (!frames.is_array()) file.fail(key, "a list", frames);
    const std::string one = std::string(key).substr(0, std::string_view(key).size() - 1);
    std::size_t unusable = 0;
    std::string first_fault;
    for (std::size_t i = 0; i < frames.size(); ++i) {
        try {
            TransformsFrame item;
            scaled += read_frame({frames[i], fmt::format("{}: {} {}", file.where(), one, i)}, file, item);
            out.push_back(std::move(item));
        } catch (const DataError& error) {
            if (unusable++ == 0) first_fault = error.what();
        }
    }
    if (unusable == 0) return;
    if (out.empty()) throw DataError(first_fault);
    notes.push_back(fmt::format("{} of {} {} are left out because they cannot be used (first: {})", unusable,
                                frames.size(), key, first_fault));
}

/// Quotes the words NaN and Infinity, which Python writes although they are not JSON. The reader of a number then
/// rejects the value with the name of its key, instead of the whole file being rejected.
std::string quote_non_numbers(const std::string& text) {
    constexpr std::string_view kWords[] = {"NaN", "-Infinity", "Infinity"};
    if (std::ranges::none_of(kWords, [&](std::string_view word) { return text.find(word) != std::string::npos; }))
        return text;
    std::string out;
    bool in_string = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const std::string_view rest = std::string_view(text).substr(i);
        const auto word = std::ranges::find_if(kWords, [&](std::string_view w) { return rest.starts_with(w); });
        if (!in_string && word != std::end(kWords)) {
            out += fmt::format("\"{}\"", *word);
            i += word->size() - 1;
            continue;
        }
        if (in_string && text[i] == '\\' && i + 1 < text.size())
            out += text[i++];
        else if (text[i] == '"')
            in_string = !in_string;
        out += text[i];
    }
    return out;
}

}  // namespace

TransformsFile read_transforms(const fs::path& path) {
    const std::string text = quote_non_numbers(read_input_text(path));
    json root;
    try {
        root = parse_json(text, true);
    } catch (const json::exception& error) {
        throw DataError(fmt::format("{}: not valid JSON: {}", path.string(), error.what()));
    }

    TransformsFile out;
    out.path = path;
    const Object file(root, path.string());
    std::size_t scaled = 0;
    read_frames(file, "frames", out.frames, scaled, out.notes);
    if (file.find("test_frames")) read_frames(file, "test_frames", out.test_frames, scaled, out.notes);
    if (scaled > 0)
        out.notes.push_back(fmt::format("{}: {} transform_matrix hold a scale: only rotation and position are used",
                                        path.string(), scaled));
    out.train_filenames = read_names(file, "train_filenames");
    out.val_filenames = read_names(file, "val_filenames");
    out.test_filenames = read_names(file, "test_filenames");
    if (const auto points = file.text("ply_file_path"); points && !points->empty())
        out.point_file = normal_path(*points);
    return out;
}

LensCamera resolve_intrinsics(const TransformsIntrinsics& in, int image_width, int image_height,
                              const std::string& where) {
    LensCamera lens{
        .model = in.model, .width = in.width.value_or(image_width), .height = in.height.value_or(image_height)};
    lens.distortion = in.distortion;
    const auto focal = [](std::optional<double> length, std::optional<double> angle,
                          int size) -> std::optional<double> {
        if (length) return length;
        if (angle) return 0.5 * size / std::tan(0.5 * *angle);
        return {};
    };
    const std::optional<double> fx = focal(in.focal_x, in.angle_x, lens.width),
                                fy = focal(in.focal_y, in.angle_y, lens.height);
    if (!fx && !fy)
        throw DataError(fmt::format(
            "{}: no focal length; one of the keys fl_x, fl_y, camera_angle_x, camera_angle_y, x_fov, y_fov is needed",
            where));
    // If only one focal length is given, pixels are square.
    lens.fx = fx ? *fx : *fy;
    lens.fy = fy ? *fy : *fx;
    if (!std::isfinite(lens.fx) || !std::isfinite(lens.fy))
        throw DataError(fmt::format("{}: the focal length is not finite; the angle of view is too small", where));
    lens.cx = in.cx.value_or(0.5 * lens.width);
    lens.cy = in.cy.value_or(0.5 * lens.height);
    return lens;
}

}  // namespace gs
